"""Damaged mesh files: each is read right, or refused in one sentence, soon.

    python -m tests.hostile 500 [SEED]

damages small files of each format at random and prints how many were read, how many refused, and what went wrong.
"""

from __future__ import annotations

import gzip
import re
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pyvista as pv
from ngfsi_geometry.external import ExternalMesh

from ngfsi.errors import NgfsiError
from ngfsi.mesh.domain import Domain
from ngfsi.store.export import ABAQUS
from tests.geometry.test_external import cells_of, raw_mesh, tube
from tests.geometry.test_meshfiles import dim_of, msh41
from tests.vein import domain_of

LONGEST = 20.0
"""Seconds for one file."""
Damage = Callable[[np.random.Generator, bytes], bytes]


def truncated(rng: np.random.Generator, data: bytes) -> bytes:
    return data[: int(rng.integers(0, len(data)))]


def flipped(rng: np.random.Generator, data: bytes) -> bytes:
    """A few bytes are others."""
    found = bytearray(data)
    for place in rng.integers(0, len(data), int(rng.integers(1, 20))):
        found[int(place)] = int(rng.integers(0, 256))
    return bytes(found)


def garbage(rng: np.random.Generator, data: bytes) -> bytes:
    """A part is noise."""
    start, end = sorted(rng.integers(0, len(data), 2).tolist())
    return data[:start] + rng.bytes(end - start) + data[end:]


def cut_out(rng: np.random.Generator, data: bytes) -> bytes:
    start, end = sorted(rng.integers(0, len(data), 2).tolist())
    return data[:start] + data[end:]


def repeated(rng: np.random.Generator, data: bytes) -> bytes:
    start, end = sorted(rng.integers(0, len(data), 2).tolist())
    return data[:end] + data[start:]


def other_number(rng: np.random.Generator, data: bytes) -> bytes:
    """A number is huge, negative, none, or another: nodes coincide, cells turn over, faces belong to three cells."""
    found = list(re.finditer(rb"-?\d+(\.\d+)?(e[-+]?\d+)?", data))
    new = (b"99999999999999999999", b"-1", b"nan", b"1e308", b"0", b"7", b"2147483648", b"-", b"inf", b"100000000000")
    for _ in range(int(rng.integers(1, 4))):
        match = found[int(rng.integers(0, len(found)))]
        data = data[: match.start()] + new[int(rng.integers(0, len(new)))] + data[match.end() :]
    return data


def other_line(rng: np.random.Generator, data: bytes) -> bytes:
    """Two lines change places, or one is there twice."""
    lines = data.split(b"\n")
    a, b = rng.integers(0, len(lines), 2).tolist()
    lines[a], lines[b] = (lines[b], lines[a]) if rng.random() < 0.5 else (lines[b], lines[b])
    return b"\n".join(lines)


DAMAGES: tuple[Damage, ...] = (truncated, flipped, garbage, cut_out, repeated, other_number, other_line)


def originals(folder: Path) -> dict[Path, dict[str, str]]:
    """Write a small tube in each format; return the files and the names of their groups."""
    points, rows = cells_of(tube("mixed", 1))
    raw, numbers = raw_mesh(points, rows, "gmsh:physical")
    raw.cell_data["gmsh:geometrical"] = raw.cell_data["gmsh:physical"]
    raw.field_data = {name: np.array([k, dim_of(name)]) for name, k in numbers.items()}
    by_number = {str(k): name for name, k in numbers.items()}
    files: dict[Path, dict[str, str]] = {}
    for name, binary in (("text", False), ("binary", True)):
        (folder / f"{name}41.msh").write_bytes(msh41(points, rows, binary=binary))
        meshio.write(folder / f"{name}22.msh", raw, file_format="gmsh22", binary=binary)
        files |= {folder / f"{name}41.msh": {}, folder / f"{name}22.msh": {}}
    plain, _ = raw_mesh(points, rows, "part")
    meshio.write(folder / "tube.vtu", plain)
    meshio.write(folder / "text.vtu", plain, binary=False)
    pv.from_meshio(plain).save(folder / "raw.vtu")
    meshio.write(folder / "tube.xdmf", plain, data_format="XML")
    files |= {folder / name: by_number for name in ("tube.vtu", "text.vtu", "raw.vtu", "tube.xdmf")}
    lines = ["*Node", *(f"{k}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in enumerate(points.tolist(), 1))]
    count = 0
    for (name, kind), cells in rows.items():
        lines.append(f"*Element, type={ABAQUS[kind]}, elset={name}")
        for cell in cells:
            count += 1
            lines.append(", ".join(map(str, (count, *(n + 1 for n in cell)))))
    (folder / "tube.inp").write_text("\n".join(lines) + "\n")
    files[folder / "tube.inp"] = {}
    domain_of(tube("mixed", 1)).mesh.ngmesh.Save(str(folder / "tube.vol"))
    (folder / "tube.vol.gz").write_bytes(gzip.compress((folder / "tube.vol").read_bytes()))
    return files | {folder / "tube.vol": {}, folder / "tube.vol.gz": {}}


SAID: list[str] = []


def outcome(file: Path, names: dict[str, str]) -> str:
    """Return "read", "refused", or what is wrong with how a file is taken."""
    start = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            domain = Domain.build(ExternalMesh(file=str(file), names=names), cache=False)
        found = "read" if domain.volume() > 0 else "read without volume"
    except NgfsiError as error:
        SAID.append(str(error))
        found = "refused" if str(error) and "\n" not in str(error) else f"no sentence: {error!r}"
    except Exception as error:
        found = f"{type(error).__name__}: {error}"
    seconds = time.perf_counter() - start
    return found if seconds < LONGEST else f"{seconds:.0f} s"


def attack(count: int, seed: int, folder: Path) -> tuple[Counter[str], list[str]]:
    """Damage files; return counts of what came of it, and what is wrong, with the number of the damage."""
    rng = np.random.default_rng(seed)
    files = originals(folder)
    (folder / "damaged").mkdir()
    counts: Counter[str] = Counter()
    wrong = []
    for number in range(count):
        source = list(files)[number % len(files)]
        damage = DAMAGES[int(rng.integers(0, len(DAMAGES)))]
        file = folder / "damaged" / source.name
        file.write_bytes(damage(rng, source.read_bytes()))
        found = outcome(file, files[source])
        counts[found if found in ("read", "refused") else "wrong"] += 1
        if found not in ("read", "refused"):
            wrong.append(f"{number} {source.name} {damage.__name__}: {found}")
            (folder / f"kept-{number}{source.suffix}").write_bytes(file.read_bytes())
    return counts, wrong


def main(count: str = "500", seed: str = "1") -> int:
    with tempfile.TemporaryDirectory(prefix="ngfsi-hostile-") as folder:
        counts, wrong = attack(int(count), int(seed), Path(folder))
    print(*wrong, dict(counts), sep="\n")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
