"""Voxels from files: NIfTI, NRRD and other images, and DICOM series, in the patient's axes, with names of segments.

Axes are turned such that columns run lateral, rows anterior and slices proximal, as of a right leg; what then is left
of an oblique direction is a rotation of the whole stack, which changes no area, and the stack is taken in its own axes.
Slices that are shifted against each other, as by a tilted gantry, keep their planes: their distance is that between the
planes, and each has its shift.
"""

from __future__ import annotations

import gzip
import json
import re
import struct
import tempfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ngfsi.errors import GeometryError
from ngfsi.units import to_si

Array = NDArray[np.float64]

EVEN = 0.01
"""Relative difference of slice distances that counts as even."""
SQUARE = 1e-3
"""Cosine of the angle between rows and columns that counts as a right one."""
STRAIGHT = 1e-5
"""Shift of a slice over its distance from the next that counts as none: files round it so."""
TO_AXES = np.diag([-1.0, -1.0, 1.0])
"""From SimpleITK's axes, which run left, posterior and up."""
MOST_VOXELS = 2_000_000_000
SMALLEST, LARGEST, FARTHEST = 1e-3, 100.0, 1e5
"""Sizes of voxels, and the place of the first one, that are taken for those of a leg [mm]."""
NIFTI_HEADER = 348


class Segment(NamedTuple):
    """A named part of an image: its number, and the layer of a file with several."""

    name: str
    number: int
    layer: int = 0


@dataclass(frozen=True)
class Volume:
    """Voxels in the axes of the geometries.

    Attributes:
        values: shape (slices, rows along y, columns along x), with several layers a further axis.
        origin, spacing: centre of the first voxel, and distances of the voxels, (x, y, z) [m].
        shift: of each slice against the one before (x, y) [m].
        segments: what the file names.
    """

    values: NDArray[Any]
    origin: tuple[float, float, float]
    spacing: tuple[float, float, float]
    shift: tuple[float, float]
    segments: tuple[Segment, ...] = ()


def read_volume(path: Path) -> Volume:
    """Return the voxels in an image file, or in a folder with one DICOM series.

    Raises:
        GeometryError: there is no such image, slices are missing or uneven, or rows and columns at no right angle.
    """
    import SimpleITK as sitk  # noqa: N813 - its usual name

    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    try:
        if path.is_dir():
            return volume_of(*_read_series(path))
        if (sheared := _sheared_nifti(path)) is not None:
            return volume_of(*sheared)
        _check_size(path)
        return volume_of(sitk.ReadImage(str(path)))
    except RuntimeError as error:
        raise GeometryError(f"'{path}' cannot be read as NIfTI, NRRD or another image: {_reason(error)}") from None
    except MemoryError:
        raise GeometryError(f"'{path}' does not fit into the memory: cut out the part that is wanted") from None
    except GeometryError as error:
        raise GeometryError(f"'{path}': {error}" if str(path) not in str(error) else str(error)) from None


def volume_of(image: Any, steps: Array | None = None) -> Volume:
    """Return the voxels of a SimpleITK image (mm).

    Args:
        steps: ways (3, 3) [mm] from a voxel to the next one along its axes, in columns, in place of the image's own.

    Raises:
        GeometryError: it has not three dimensions, or rows and columns are at no right angle.
    """
    import SimpleITK as sitk  # noqa: N813 - its usual name

    if image.GetDimension() != 3:
        raise GeometryError("a label map has three dimensions and one number in each voxel: save it as a volume")
    if steps is None:
        steps = np.reshape(image.GetDirection(), (3, 3)) * image.GetSpacing()
    values = sitk.GetArrayFromImage(image)
    values, ways, first = _turned(values, TO_AXES @ steps, TO_AXES @ np.array(image.GetOrigin()))
    lengths = np.linalg.norm(ways, axis=0)
    if not (np.all(np.isfinite(ways)) and np.all(lengths > 0) and np.all(np.isfinite(first))):
        raise GeometryError("the image says no distances of its voxels: set spacing, direction and origin in it")
    if np.min(lengths) < SMALLEST or np.max(lengths) > LARGEST or np.max(np.abs(first)) > FARTHEST:
        sizes = " x ".join(f"{length:.3g}" for length in lengths)
        raise GeometryError(
            f"the image says its voxels are {sizes} mm and begin at ({', '.join(f'{c:.3g}' for c in first)}) mm: set "
            "spacing and origin in it, in mm"
        )
    x, y = (ways[:, k] / lengths[k] for k in range(2))
    if abs(x @ y) > SQUARE:
        angle = np.degrees(np.arccos(abs(x @ y)))
        raise GeometryError(
            f"rows and columns of its slices are at {angle:.1f} degrees, not at right angles: resample the image to a "
            "grid at right angles, with nearest neighbours to keep labels, or set its qform"
        )
    normal = np.cross(x, y)
    normal /= np.linalg.norm(normal)
    rise = float(ways[:, 2] @ normal)
    if rise < 0.5 * lengths[2]:
        raise GeometryError("its slices are shifted by more than their distance: resample the image to a straight grid")
    shift = np.array([ways[:, 2] @ x, ways[:, 2] @ y])
    shift[np.abs(shift) < STRAIGHT * rise] = 0.0
    origin = np.array([x @ first, y @ first, normal @ first])
    metres = [to_si(float(part), "mm") for part in (*origin, *lengths[:2], rise, *shift)]
    return Volume(values, (metres[0], metres[1], metres[2]), (metres[3], metres[4], metres[5]),
                  (metres[6], metres[7]), _segments(image))  # fmt: skip


def _turned(values: NDArray[Any], ways: Array, first: Array) -> tuple[NDArray[Any], Array, Array]:
    """Return voxels (z, y, x, ...), ways and place of the first one along axes nearest to those of the geometries."""
    cosines = ways / np.maximum(np.linalg.norm(ways, axis=0), 1e-300)
    order = max(permutations(range(3)), key=lambda p: sum(abs(cosines[k, axis]) for k, axis in enumerate(p)))
    # arrays have the axes of the image in reverse
    turned = np.moveaxis(values, [2 - axis for axis in order], [2, 1, 0])
    ways = ways[:, list(order)]
    for k in range(3):
        if ways[k, k] < 0:
            first = first + (turned.shape[2 - k] - 1) * ways[:, k]
            ways = ways * np.where(np.arange(3) == k, -1.0, 1.0)
            turned = np.flip(turned, 2 - k)
    return turned, ways, first


def _segments(image: Any) -> tuple[Segment, ...]:
    """Return what 3D Slicer says of segments in the head of a .seg.nrrd."""
    found = []
    for key in image.GetMetaDataKeys():
        if match := re.fullmatch(r"Segment(\d+)_Name", key):
            number, layer = (_meta(image, f"Segment{match[1]}_{part}") for part in ("LabelValue", "Layer"))
            if number.isdigit():
                found.append((int(match[1]), Segment(image.GetMetaData(key), int(number), int(layer or 0))))
    return tuple(segment for _, segment in sorted(found))


def _meta(image: Any, key: str) -> str:
    return str(image.GetMetaData(key)).strip() if image.HasMetaDataKey(key) else ""


def _reason(error: RuntimeError) -> str:
    """Return the last sentence of what SimpleITK says, in print."""
    lines = [line for line in str(error).strip().splitlines() if line.strip()] or [type(error).__name__]
    return "".join(c if c.isprintable() else " " for c in lines[-1].split("ERROR: ")[-1])[:300]


def _check_size(path: Path) -> None:
    import SimpleITK as sitk  # noqa: N813 - its usual name

    reader = sitk.ImageFileReader()
    reader.SetFileName(str(path))
    reader.ReadImageInformation()
    if (voxels := float(np.prod([float(n) for n in reader.GetSize()]))) > MOST_VOXELS:
        raise GeometryError(f"the image says it has {voxels:.2g} voxels: cut out the part that is wanted")


def _sheared_nifti(path: Path) -> tuple[Any, Array] | None:
    """Return the image (mm) in a NIfTI file whose sform is sheared, and its steps; None for all other files.

    ITK refuses such files or takes the qform in silence.

    Raises:
        GeometryError: the file is shorter than its head says, which ITK does not notice.
    """
    import SimpleITK as sitk  # noqa: N813 - its usual name

    if not path.name.endswith((".nii", ".nii.gz")):
        return None
    try:
        with gzip.open(path) if path.name.endswith(".gz") else path.open("rb") as file:
            data = file.read()
    except (OSError, EOFError, zlib.error) as error:
        raise GeometryError(f"the file is damaged or cut off ({error}): get it again") from None
    order = "<" if data[:4] == struct.pack("<i", NIFTI_HEADER) else ">"
    if len(data) < NIFTI_HEADER or data[:4] != struct.pack(f"{order}i", NIFTI_HEADER):
        return None
    count, *sizes = struct.unpack(f"{order}8h", data[40:56])
    (bits,), (start,) = struct.unpack(f"{order}h", data[72:74]), struct.unpack(f"{order}f", data[108:112])
    voxels = int(np.prod([max(size, 1) for size in sizes[: max(count, 0)]], dtype=object))
    if not start + voxels * bits / 8 <= len(data):
        raise GeometryError(f"the file is damaged or cut off: its {voxels:,} voxels need more than {len(data):,} bytes")
    rows = np.reshape(struct.unpack(f"{order}12f", data[280:328]), (3, 4)).astype(float)
    ways = rows[:, :3]
    lengths = np.linalg.norm(ways, axis=0)
    if struct.unpack(f"{order}h", data[254:256])[0] <= 0 or not np.all(np.isfinite(rows)) or np.min(lengths) <= 0:
        return None
    cosines = ways / lengths
    if np.max(np.abs(cosines.T @ cosines - np.eye(3))) <= SQUARE:
        return None
    with tempfile.TemporaryDirectory(prefix="ngfsi-image-") as scratch:
        plain = Path(scratch) / "plain.nii"
        # without codes of its forms the file is read with the sizes of its voxels alone
        plain.write_bytes(data[:252] + bytes(4) + data[256:])
        image = sitk.ReadImage(str(plain))
    image.SetOrigin([float(c) for c in TO_AXES @ rows[:, 3]])
    return image, TO_AXES @ ways


def _read_series(folder: Path) -> tuple[Any, Array]:
    """Return the image (mm) of the one DICOM series in a folder, and its steps, with the shifts of the slices."""
    import SimpleITK as sitk  # noqa: N813 - its usual name

    series = sitk.ImageSeriesReader.GetGDCMSeriesIDs(str(folder))
    if len(series) != 1:
        raise GeometryError(f"'{folder}' holds {len(series)} DICOM series: give a folder with exactly one")
    reader = sitk.ImageSeriesReader()
    reader.SetFileNames(sitk.ImageSeriesReader.GetGDCMSeriesFileNames(str(folder), series[0]))
    reader.MetaDataDictionaryArrayUpdateOn()
    image = reader.Execute()
    if image.GetDimension() != 3:
        raise GeometryError(
            f"'{folder}': its slices are no images of a plane: export the segmentation as NIfTI or NRRD"
        )
    steps = np.reshape(image.GetDirection(), (3, 3)) * image.GetSpacing()
    if image.GetDepth() < 2:
        return image, steps
    if reader.HasMetaDataKey(0, "0008|0060") and reader.GetMetaData(0, "0008|0060").strip() == "SEG":
        raise GeometryError(f"'{folder}' holds a DICOM segmentation object: export it as NIfTI or NRRD")
    try:
        places = np.array([
            [float(part) for part in reader.GetMetaData(k, "0020|0032").split("\\")] for k in range(image.GetDepth())
        ])  # fmt: skip
        ways = np.diff(places.reshape(image.GetDepth(), 3), axis=0)
    except (RuntimeError, ValueError):
        raise GeometryError(
            f"'{folder}': slices do not say where they lie (Image Position): export them anew"
        ) from None
    rises = ways @ (steps[:, 2] / np.linalg.norm(steps[:, 2]))
    usual = np.median(rises)
    if np.max(np.abs(rises - usual)) > EVEN * abs(usual):
        worst = int(np.argmax(np.abs(rises - usual)))
        raise GeometryError(
            f"'{folder}': slices {worst} and {worst + 1} are {rises[worst]:.3g} mm apart, the others {usual:.3g} mm: "
            "add the missing slices or resample the series"
        )
    mean = (places[-1] - places[0]) / (len(places) - 1)
    away = np.linalg.norm(ways - mean, axis=1)
    if np.max(away) > EVEN * np.linalg.norm(mean):
        worst = int(np.argmax(away))
        raise GeometryError(
            f"'{folder}': slice {worst + 1} is shifted against slice {worst} otherwise than the others, by "
            f"{away[worst]:.3g} mm: resample the series to a straight grid"
        )
    steps[:, 2] = mean
    return image, steps


def read_table(path: Path) -> tuple[Segment, ...]:
    """Return the names of numbers in a table: of ITK-SNAP, FreeSurfer or 3D Slicer, CSV or TSV with a head, or JSON.

    Raises:
        GeometryError: it cannot be read or names nothing.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise GeometryError(f"the table of labels '{path}' cannot be read: {error}") from None
    found = _of_json(text) if text.lstrip().startswith("{") else _of_lines(text.splitlines())
    if not found:
        raise GeometryError(
            f"the table of labels '{path}' names no number: write CSV with the head number,name, or a JSON object"
        )
    return tuple(found)


NUMBER_HEADS = "number", "index", "label", "value", "id", "label value"
NAME_HEADS = "name", "label name", "structure"
SNAP_LINE, FREESURFER_LINE = r'\s*(\d+)\s.*"([^"]+)"\s*$', r"\s*(\d+)\s+(\S+)(\s+\d+){3,4}\s*$"


def _of_json(text: str) -> list[Segment]:
    try:
        data = json.loads(text)
    except (ValueError, RecursionError):
        return []
    data = data.get("labels", data)
    found = []
    for key, value in data.items() if isinstance(data, dict) else ():
        name, number = (value, key) if str(key).isdigit() else (key, value)
        if isinstance(name, str) and str(number).isdigit():
            found.append(Segment(name, int(number)))
    return found


def _of_lines(lines: Sequence[str]) -> list[Segment]:
    found = []
    columns: tuple[int, int] | None = None
    for line in lines:
        separator = next((c for c in ("\t", ";", ",") if c in line), None)
        cells = [cell.strip().strip('"') for cell in (line.split(separator) if separator else line.split())]
        heads = [cell.lower() for cell in cells]
        number = next((heads.index(head) for head in NUMBER_HEADS if head in heads), None)
        name = next((heads.index(head) for head in NAME_HEADS if head in heads), None)
        if number is not None and name is not None:
            columns = number, name
        elif columns and len(cells) > max(columns) and cells[columns[0]].isdigit():
            found.append(Segment(cells[columns[1]], int(cells[columns[0]])))
        elif match := re.match(SNAP_LINE, line) or re.match(FREESURFER_LINE, line):
            found.append(Segment(match[2], int(match[1])))
    return found
