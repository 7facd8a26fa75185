"""Damaged images: cut off, overwritten, inflated, with other heads; each is one sentence or a right read.

    python -m tests.mutated_images [NUMBER]

tries as many (500 by default) and ends with 1 if one of them does something else.
"""

from __future__ import annotations

import gzip
import os
import struct
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import SimpleITK as sitk  # noqa: N813 - its usual name
from ngfsi_geometry.imaging import LABELS, LabelMap

from ngfsi.errors import NgfsiError

NUMBER = 500
LONGEST = 20.0
"""Seconds that one file may take."""
WORDS = b"\0", b"\xff\xff\xff\xff", b"-1", b"1e999", b"nan", b"../../x", b"\x7f", b"99999999999", b"gzip", b"raw", b"\n"
HEADS = b"dimension: ", b"sizes: ", b"encoding: ", b"type: ", b"space directions: ", b"NDims = ", b"ElementType = "
FORMATS = "labels.nii", "labels.nii.gz", "labels.nrrd", "labels.seg.nrrd", "labels.mha"


def sound() -> Any:
    """Return a small label map with skin, bones and a vein."""
    y, x = np.mgrid[:40, :44]
    layer = np.zeros((40, 44), dtype=np.uint8)
    for name, (i, j), radius in (
        ("skin", (22, 20), 18), ("tibia", (16, 28), 5), ("fibula", (30, 24), 3), ("lumen", (22, 14), 3)
    ):  # fmt: skip
        layer[np.hypot(x - i, y - j) < radius] = LABELS[name]
    image = sitk.GetImageFromArray(np.repeat(layer[None], 5, axis=0))
    image.SetSpacing([1.0, 1.0, 3.0])
    for k, name in enumerate(("skin", "tibia", "fibula", "lumen")):
        image.SetMetaData(f"Segment{k}_Name", name)
        image.SetMetaData(f"Segment{k}_LabelValue", str(LABELS[name]))
    return image


def damaged(rng: np.random.Generator, content: bytes) -> bytes:
    """Return a file's content with one to three things wrong."""
    data = bytearray(content)
    for _ in range(rng.integers(1, 4)):
        how = rng.integers(7)
        at = int(rng.integers(max(1, min(len(data), 400))))
        if how == 0:
            del data[rng.integers(len(data) + 1) :]
        elif how == 1:
            data[at : at + 4] = rng.bytes(4)
        elif how == 2:
            word = WORDS[rng.integers(len(WORDS))]
            data[at : at + len(word)] = word
        elif how == 3:
            data[at:at] = rng.bytes(int(rng.choice([1, 7, 1000])))
        elif how == 4:
            head = HEADS[rng.integers(len(HEADS))]
            place = data.find(head)
            if place >= 0:
                end = data.find(b"\n", place)
                data[place + len(head) : end] = WORDS[rng.integers(len(WORDS))]
        elif how == 5 and len(data) > 120:
            # sizes and codes of a NIfTI head
            struct.pack_into(
                "<h", data, int(rng.choice([40, 42, 44, 46, 70, 72, 252, 254])), int(rng.integers(-9, 32767))
            )
        elif len(data) > 400:
            struct.pack_into("<f", data, int(rng.choice([76, 80, 84, 88, 108, 112, 280, 284, 288, 296, 320])),
                             float(rng.choice([0.0, -1.0, 1e30, np.nan, np.inf, 1e-30])))  # fmt: skip
    return bytes(data)


def tried(rng: np.random.Generator, folder: Path) -> tuple[str, float]:
    """Damage a file, read it and outline its parts; return what came of it, "read" or the sentence, and the seconds."""
    name = FORMATS[rng.integers(len(FORMATS))]
    file = folder / name
    sitk.WriteImage(sound(), file)
    content = file.read_bytes()
    packed = name.endswith(".gz") and rng.random() < 0.7
    changed = damaged(rng, gzip.decompress(content) if packed else content)
    file.write_bytes(gzip.compress(changed, 1) if packed else changed)
    start = time.perf_counter()
    try:
        image = LabelMap.read(file)
        for part in ("skin", "tibia", "fibula", "lumen"):
            outline = image.outline(part, 2)
            assert outline.area > 0
        image.stack()
        said = "read"
        code = 2
    except NgfsiError as error:
        said, code = str(error), error.exit_code
    assert code == 2
    assert said.isprintable(), said
    assert len(said) < 2000
    seconds = time.perf_counter() - start
    file.unlink()
    assert not list(folder.iterdir()), "something was written beside the file"
    return said, seconds


def all_tried(number: int, seed: int = 1) -> Iterator[tuple[int, str, float]]:
    """Yield for each of damaged files its number, what came of it and the seconds; whatever else came, it raises."""
    with tempfile.TemporaryDirectory(prefix="ngfsi-images-") as folder:
        for k in range(number):
            said, seconds = tried(np.random.default_rng([seed, k]), Path(folder))
            assert seconds < LONGEST, f"file {k} took {seconds:.0f} s"
            yield k, said, seconds


def main() -> int:
    """Try damaged files; return the exit code."""
    number = int(sys.argv[1]) if len(sys.argv) > 1 else NUMBER
    results = list(all_tried(number))
    read = sum(said == "read" for _, said, _ in results)
    slowest = max(seconds for *_, seconds in results)
    print(f"{number} damaged images: {read} read, {number - read} refused in one sentence, slowest {slowest:.1f} s")
    return os.EX_OK


if __name__ == "__main__":
    sys.exit(main())
