"""Label maps: geometry to phantom to geometry, patient axes, refusals that name the slice."""

from __future__ import annotations

import gzip
import struct
from collections.abc import Callable, Sequence
from functools import cache
from itertools import permutations, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813 - its usual name
from ngfsi_geometry.calf_section import COMPARTMENTS, Vein, subject
from ngfsi_geometry.imaging import LABELS, PIXEL, POINTS_OF_A_MODE, SLICE, LabelMap, phantom_stack
from scipy.ndimage import label

from ngfsi.errors import GeometryError
from ngfsi.outlines.outline import Outline, closed, dense, distances
from tests.vein import domain_of

ONE = subject(1)
FRAME = Outline.circle(0.0, 0.0, 20e-3)
SLICES = 8


def voxel_error(outline: Outline, pixel: float = PIXEL) -> float:
    """Standard deviation [m2] of an area counted in pixels.

    Each pixel along the curve is in or out by its centre: an error evenly spread over half a pixel to either side.
    """
    return float(np.sqrt(outline.length / pixel / 12) * pixel**2)


def ellipse(a: float, b: float, x: float, y: float) -> Outline:
    t = 2 * np.pi * np.arange(48) / 48
    return Outline.through(np.column_stack([x + a * np.cos(t), y + b * np.sin(t)]))


LUMENS = [ellipse(3e-3 + 1e-4 * k, 2e-3, 2e-3 + 0.3e-3 * k, -1e-3 - 0.17e-3 * k) for k in range(SLICES)]


@cache
def vein_stack() -> Any:
    """Label map of a bent vein alone."""
    return phantom_stack([{"skin": FRAME, "lumen": lumen} for lumen in LUMENS], FRAME)[0]


def test_section_to_phantom_to_section(tmp_path: Path) -> None:
    parts = {"skin": ONE.skin, "fat": ONE.skin.offset(-5e-3), "tibia": ONE.tibia, "fibula": ONE.fibula}
    given = {**parts, "lumen": ONE.veins[0].lumen, "lumen_2": Outline.circle(-12e-3, -18e-3, 2.5e-3)}
    # what is outside of the fascia is fat, what is inside without a label of its own is tissue
    labels, grey = phantom_stack([given] * 2, ONE.skin)
    array = sitk.GetArrayFromImage(labels)
    skin, fat = array == LABELS["skin"], array == LABELS["fat"]
    array[skin], array[fat] = LABELS["fat"], LABELS["skin"]
    image = sitk.GetImageFromArray(array)
    image.CopyInformation(labels)
    sitk.WriteImage(image, tmp_path / "labels.nii.gz")
    section = LabelMap.read(tmp_path / "labels.nii.gz").section(1)
    assert section.solids == ("tissue", "wall", "fat")
    found = {"skin": section.skin, "fat": section.fascia, "tibia": section.tibia, "fibula": section.fibula}
    found |= {"lumen": section.veins[0].lumen, "lumen_2": section.veins[1].lumen}
    for name, outline in found.items():
        true = given[name]
        assert outline.area == pytest.approx(true.area, rel=0, abs=3 * voxel_error(true)), name
        assert outline.centroid == pytest.approx(true.centroid, abs=0.2 * PIXEL), name
        # a smooth outline: the stairs of the pixels would be 4 / pi times as long
        assert outline.length == pytest.approx(true.length, rel=0.03), name
    assert grey.GetPixel(40, 40, 0) == pytest.approx(100.0)


def test_compartments_come_back() -> None:
    """All four regions with their areas: each may lose a pixel along its border with another, which stays a septum."""
    behind = ellipse(26e-3, 12e-3, -2e-3, -34e-3)
    given = subject(1, superficial_posterior=behind)
    parts = {name: getattr(given, name) for name in ("skin", "tibia", "fibula", *COMPARTMENTS)}
    image = LabelMap.of_image(phantom_stack([{**parts, "lumen": given.veins[0].lumen}], given.skin)[0])
    section = image.section(0)
    assert set(section.solids) == {"tissue", "wall", *COMPARTMENTS}
    found, true = domain_of(section), domain_of(given)
    for name in COMPARTMENTS:
        border = getattr(given, name).length * PIXEL
        assert found.volume(name) == pytest.approx(true.volume(name), rel=0, abs=0.5 * border), name
        assert found.volume(name) == pytest.approx(true.volume(name), rel=0.15), name
    assert sum(map(found.volume, found.regions)) == pytest.approx(sum(map(true.volume, true.regions)), rel=5e-3)


def test_compartments_that_touch() -> None:
    """Two rectangles side by side lose a pixel each along their border; into a bone the outline reaches 3 pixels."""
    numbers = np.full((1, 40, 60), LABELS["skin"])
    numbers[0, 10:30, 10:30], numbers[0, 10:30, 30:50] = LABELS["anterior"], LABELS["lateral"]
    numbers[0, 10:30, 0:10] = LABELS["tibia"]
    image = LabelMap(numbers, (0.0, 0.0, 0.0), (PIXEL, PIXEL, SLICE), LABELS)
    anterior, lateral = (np.flatnonzero(image._mask(name, 0)[20]) for name in ("anterior", "lateral"))
    assert (anterior[0], anterior[-1]) == (7, 28)
    assert (lateral[0], lateral[-1]) == (31, 49)


@pytest.mark.parametrize("suffix", ["nii.gz", "nrrd", "mha"])
def test_vein_to_phantom_to_vein(tmp_path: Path, suffix: str) -> None:
    """Areas of single slices within their voxel error, and their mean within that of the mean: no bias."""
    file = tmp_path / f"labels.{suffix}"
    sitk.WriteImage(vein_stack(), file)
    vein = LabelMap.read(file).vein(inlet_diameters=2.0)
    assert vein.heights == pytest.approx(SLICE * np.arange(SLICES), rel=1e-6, abs=1e-9)
    errors = np.array([found.area - true.area for found, true in zip(vein.outlines, LUMENS, strict=True)])
    sigma = np.array([voxel_error(true) for true in LUMENS])
    assert np.all(np.abs(errors) < 3 * sigma)
    assert abs(errors.mean()) < 3 * sigma.mean() / np.sqrt(SLICES)
    for found, true in zip(vein.outlines, LUMENS, strict=True):
        assert found.centroid == pytest.approx(true.centroid, abs=0.2 * PIXEL)


def test_pixels_of_two_sizes() -> None:
    """The area of the outline is that of the pixels, also where they are no squares."""
    numbers = np.zeros((1, 40, 20), dtype=np.int64)
    y, x = np.mgrid[:40, :20]
    numbers[0][((x - 10) / 4.5) ** 2 + ((y - 20) / 9) ** 2 < 1] = LABELS["lumen"]
    image = LabelMap(numbers, (0.0, 0.0, 0.0), (2e-3, 1e-3, 5e-3), LABELS)
    outline = image.outline("lumen", 0)
    assert outline.area == pytest.approx(float((numbers > 0).sum()) * 2e-6, rel=1e-3)
    assert outline.centroid == pytest.approx([20e-3, 20e-3], abs=0.2e-3)
    assert np.ptp(outline.points, axis=0) == pytest.approx([18e-3, 18e-3], rel=0.1)


def noisy(seed: int, size: int = 40) -> Any:
    """Return the mask of an ellipse of 11 by 7 pixels whose edge is rough."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:size, :size]
    angle = np.arctan2(y - 20, x - 19)
    rough = sum(rng.normal(0, 0.03) * np.cos(n * angle + rng.uniform(0, 6)) for n in range(2, 9))
    rim = ((x - 19) / 11) ** 2 + ((y - 20) / 7) ** 2
    return rim < (1 + rough) ** 2 + rng.normal(0, 0.04, rim.shape)


def map_of(mask: Any, pixel: float = PIXEL) -> LabelMap:
    numbers = np.where(mask, LABELS["lumen"], 0)[None]
    return LabelMap(numbers, (0.0, 0.0, 0.0), (pixel, pixel, SLICE), LABELS)


def test_noisy_labels_become_smooth_curves() -> None:
    """Area and centroid of the pixels, nowhere a pixel beside their edge, and few enough points for a wall around."""
    for seed in range(6):
        mask = noisy(seed)
        if label(mask)[1] > 1:
            continue
        image = map_of(mask)
        outline = image.outline("lumen", 0)
        away = distances(dense(closed(outline.resampled(400)), PIXEL / 4), image.edge("lumen", 0))
        assert outline.area == pytest.approx(mask.sum() * PIXEL**2, rel=1e-3)
        middle = PIXEL * np.mean(np.argwhere(mask)[:, ::-1], axis=0)
        assert outline.centroid == pytest.approx(middle, abs=1e-3 * PIXEL)
        assert away.max() <= 1.05 * PIXEL
        assert len(outline.x) <= 8 * POINTS_OF_A_MODE
        wall = Vein(lumen=outline, wall_thickness=1e-3).outer
        assert wall.distance_to(outline) == pytest.approx(1e-3, rel=0.02)


def test_an_oval_stays_oval() -> None:
    """The fewest modes are no circle where the pixels show an ellipse, though one lay within a pixel of it."""
    y, x = np.mgrid[:40, :40]
    outline = map_of(((x - 19) / 5.5) ** 2 + ((y - 20) / 4.5) ** 2 < 1).outline("lumen", 0)
    assert np.ptp(outline.points[:, 0]) / np.ptp(outline.points[:, 1]) == pytest.approx(5.5 / 4.5, rel=0.06)


def test_a_crescent_keeps_its_shape() -> None:
    """No part that is not seen whole from its middle is squeezed into a star."""
    y, x = np.mgrid[:48, :48]
    ring = np.hypot(x - 23, y - 23)
    mask = (ring < 18) & (ring > 11) & (x > 16)
    image = map_of(mask)
    outline = image.outline("lumen", 0)
    assert outline.area == pytest.approx(mask.sum() * PIXEL**2, rel=5e-3)
    assert not outline.contains(PIXEL * np.array([[23.0, 23.0]]))[0]
    assert distances(outline.resampled(800), image.edge("lumen", 0)).max() < 1.2 * PIXEL


def _flipped(image: Any) -> Any:
    return sitk.Flip(image, [True, False, True])


def _permuted(image: Any) -> Any:
    return sitk.PermuteAxes(image, [2, 0, 1])


def _oblique(image: Any) -> Any:
    """The same voxels in a scanner's axes that are turned by 20 degrees."""
    c, s = np.cos(np.radians(20)), np.sin(np.radians(20))
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    image = sitk.Image(image)
    image.SetOrigin(list(map(float, turn @ image.GetOrigin())))
    image.SetDirection((turn @ np.reshape(image.GetDirection(), (3, 3))).ravel().tolist())
    return image


@pytest.mark.parametrize("stored", [_flipped, _permuted, _oblique])
def test_direction_matrix(stored: Callable[[Any], Any]) -> None:
    """However the voxels are stored, the patient's axes make the same vein."""
    image = vein_stack()
    plain, found = LabelMap.of_image(image).vein(), LabelMap.of_image(stored(image)).vein()
    assert found.heights == pytest.approx(plain.heights, abs=1e-9)
    for one, other in zip(found.outlines, plain.outlines, strict=True):
        assert one.area == pytest.approx(other.area, rel=1e-5)
        assert one.centroid == pytest.approx(other.centroid, abs=1e-7)


def write_series(folder: Path, image: Any, numbers: list[int], shift: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
    """Write slices of an image as a DICOM series, each shifted (mm) against the one before."""
    writer = sitk.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    for k in numbers:
        layer = sitk.Cast(image[:, :, k], sitk.sitkUInt16)
        direction = np.reshape(image.GetDirection(), (3, 3))
        place = np.array(image.TransformIndexToPhysicalPoint((0, 0, k))) + k * np.array(shift)
        for tag, value in {
            "0020|000e": "1.2.826.0.1.3680043.2.1125.1",
            "0020|000d": "1.2.826.0.1.3680043.2.1125.2",
            "0008|0018": f"1.2.826.0.1.3680043.2.1125.3.{k + 1}",
            "0008|0060": "MR",
            "0020|0013": str(k + 1),
            "0020|0032": "\\".join(f"{c:.6f}" for c in place),
            "0020|0037": "\\".join(f"{c:.6f}" for c in direction[:, :2].T.ravel()),
        }.items():
            layer.SetMetaData(tag, value)
        writer.SetFileName(str(folder / f"{k:03d}.dcm"))
        writer.Execute(layer)


def test_dicom_series(tmp_path: Path) -> None:
    image = vein_stack()
    whole, gap = tmp_path / "whole", tmp_path / "gap"
    whole.mkdir()
    gap.mkdir()
    write_series(whole, image, list(range(SLICES)))
    found, plain = LabelMap.read(whole).vein(), LabelMap.of_image(image).vein()
    assert found.heights == pytest.approx(plain.heights, abs=1e-9)
    assert found.outlines[3].centroid == pytest.approx(plain.outlines[3].centroid, abs=1e-7)
    write_series(gap, image, [0, 1, 2, 3, 5, 6, 7])
    with pytest.raises(GeometryError, match=r"slices 3 and 4 are 4 mm apart, the others 2 mm: add the missing slices"):
        LabelMap.read(gap)
    with pytest.raises(GeometryError, match="holds 0 DICOM series"):
        LabelMap.read(tmp_path)


def box() -> Any:
    """Return a small label map whose voxels, places and sides are all different, in a place of its own."""
    numbers = np.arange(4 * 5 * 6).reshape(4, 5, 6).astype(np.uint8)
    image = sitk.GetImageFromArray(numbers)
    image.SetSpacing([0.7, 0.8, 3.0])
    image.SetOrigin([-31.0, 12.0, 140.0])
    return image


@pytest.mark.parametrize("suffix", ["nii.gz", "nrrd", "mha"])
def test_every_orientation(tmp_path: Path, suffix: str) -> None:
    """All 48 orders and senses of the axes, in each format: the same voxels at the same places."""
    plain = LabelMap.of_image(box())
    for order in permutations(range(3)):
        for flips in product((False, True), repeat=3):
            image = sitk.Flip(sitk.PermuteAxes(box(), order), flips)
            sitk.WriteImage(image, tmp_path / f"box.{suffix}")
            found = LabelMap.read(tmp_path / f"box.{suffix}")
            assert np.array_equal(found.numbers, plain.numbers), (order, flips)
            assert found.spacing == pytest.approx(plain.spacing, rel=1e-6)
            assert found.origin == pytest.approx(plain.origin, rel=1e-6)


TILT = np.tan(np.radians(15))


def tilted_nifti(file: Path, ways: Any) -> None:
    """Write the bent vein with an sform (mm, NIfTI's axes) that ITK does not accept."""
    sitk.WriteImage(vein_stack(), file)
    data = bytearray(gzip.decompress(file.read_bytes()))
    rows = np.column_stack([ways, [10.0, 20.0, 30.0]])
    data[252:256] = struct.pack("<hh", 0, 1)
    data[280:328] = struct.pack("<12f", *rows.ravel())
    file.write_bytes(gzip.compress(bytes(data)))


def test_tilted_gantry(tmp_path: Path) -> None:
    """Slices keep their distance, and are shifted by its tangent; a series as a NIfTI file with a sheared sform."""
    plain = LabelMap.of_image(vein_stack())
    pixel, rise = 1e3 * PIXEL, 1e3 * SLICE
    tilted_nifti(tmp_path / "tilted.nii.gz", np.array([[pixel, 0, 0], [0, pixel, TILT * rise], [0, 0, rise]]))
    folder = tmp_path / "series"
    folder.mkdir()
    write_series(folder, vein_stack(), list(range(SLICES)), [0.0, -TILT * rise, 0.0])
    for path, start in ((tmp_path / "tilted.nii.gz", (0.01, 0.02)), (folder, plain.origin[:2])):
        found = LabelMap.read(path)
        assert np.diff(found.heights) == pytest.approx(SLICE, rel=1e-6)
        vein, straight = found.vein(), plain.vein()
        for k, (one, other) in enumerate(zip(vein.outlines, straight.outlines, strict=True)):
            moved = np.array(start) - plain.origin[:2] + [0.0, k * TILT * SLICE]
            assert one.centroid == pytest.approx(other.centroid + moved, abs=1e-7)
            assert one.area == pytest.approx(other.area, rel=1e-6)
    tilted_nifti(tmp_path / "askew.nii.gz", np.array([[pixel, 0.3 * pixel, 0], [0, pixel, 0], [0, 0, rise]]))
    with pytest.raises(GeometryError, match=r"at 73\.3 degrees, not at right angles: resample the image"):
        LabelMap.read(tmp_path / "askew.nii.gz")
    write_series(folder, vein_stack(), [3], [0.0, 0.4, 0.0])
    with pytest.raises(GeometryError, match=r"slice [34] is shifted against slice [23] otherwise than the others"):
        LabelMap.read(folder)


def slicer(image: Any, segments: list[tuple[str, int, int]]) -> Any:
    """Return an image with names of segments as 3D Slicer writes them."""
    for k, (name, number, layer) in enumerate(segments):
        for key, value in (("Name", name), ("LabelValue", str(number)), ("Layer", str(layer))):
            image.SetMetaData(f"Segment{k}_{key}", value)
    return image


def test_segments_by_name(tmp_path: Path) -> None:
    """In one layer or several that overlap, by our names or by theirs; what is above is what lies inside."""
    plain = LabelMap.of_image(vein_stack())
    lumen = sitk.Cast(vein_stack() == LABELS["lumen"], sitk.sitkUInt8)
    body = sitk.Cast(vein_stack() > 0, sitk.sitkUInt8)
    file = tmp_path / "leg.seg.nrrd"
    names = [("Skin", 1, 0), ("Peroneal vein", 1, 1)]
    sitk.WriteImage(slicer(sitk.Compose(body, lumen), names), file)
    for labels in (None, {"skin": "Skin", "lumen": "peroneal vein"}):
        found = LabelMap.read(file, labels)
        assert np.array_equal(found._mask("lumen", 2), plain._mask("lumen", 2))
        assert np.array_equal(found._mask("skin", 2), plain._mask("skin", 2))
    with pytest.raises(GeometryError, match=r"'Tibia' is not a known segment: .*Skin"):
        LabelMap.read(file, {"tibia": "Tibia"})
    with pytest.raises(GeometryError, match="several segments have the number 1, in layers: give their names"):
        LabelMap.read(file, {"lumen": 1})
    sitk.WriteImage(slicer(sitk.Image(vein_stack()), [("Skin", 1, 0), ("Soleal vein", 5, 0)]), file)
    assert LabelMap.read(file).labels == {"skin": 1, "lumen": 5}


@pytest.mark.parametrize("text", [
    "number,name\n1,skin\n5,Peroneal vein\n", "index\tname\n1\tskin\n5\tPeroneal vein\n",
    '# ITK-SnAP\n 1 255 0 0 1 1 1 "skin"\n 5 0 255 0 1 1 1 "Peroneal vein"\n',
    "#No. Name R G B A\n1 skin 0 0 0 0\n5 vein 70 130 180 0\n", '{"labels": {"skin": 1, "vein": 5}}',
    '{"1": "skin", "5": "vein"}',
])  # fmt: skip
def test_tables_of_names(tmp_path: Path, text: str) -> None:
    sitk.WriteImage(vein_stack(), tmp_path / "leg.nii.gz")
    (tmp_path / "names.txt").write_text(text)
    assert LabelMap.read(tmp_path / "leg.nii.gz", table=tmp_path / "names.txt").labels == {"skin": 1, "lumen": 5}
    (tmp_path / "names.txt").write_text("nothing")
    with pytest.raises(GeometryError, match="names no number: write CSV with the head number,name"):
        LabelMap.read(tmp_path / "leg.nii.gz", table=tmp_path / "names.txt")


def changed(change: Callable[[Any], None]) -> LabelMap:
    """Return the label map of the bent vein with some voxels changed."""
    image = LabelMap.of_image(vein_stack())
    numbers = image.numbers.copy()
    change(numbers)
    return LabelMap(numbers, image.origin, image.spacing, image.labels)


def test_refused_label_maps(tmp_path: Path) -> None:
    lumen = LABELS["lumen"]

    def emptied(numbers: Any) -> None:
        numbers[3][numbers[3] == lumen] = 1

    def speckled(numbers: Any) -> None:
        numbers[2, 8:10, 40] = lumen

    def cut(numbers: Any) -> None:
        numbers[5, :, -1] = 1

    def cornered(numbers: Any) -> None:
        numbers[6][numbers[6] == lumen] = 1
        numbers[6, 20:24, 20:24] = numbers[6, 32:36, 32:36] = lumen
        numbers[6, range(24, 32), range(24, 32)] = lumen

    with pytest.raises(GeometryError, match="slice 3 is empty of 'lumen', which lies in slices 0 to 7: label it"):
        changed(emptied).vein()
    with pytest.raises(GeometryError, match=r"slice 2: 'lumen' is in 2 pieces, the largest of .* and 0.8 mm2: remove"):
        changed(speckled).vein()
    with pytest.raises(GeometryError, match="slice 6: 'lumen' hangs together by corners of pixels"):
        changed(cornered).outline("lumen", 6)
    with pytest.raises(GeometryError, match="slice 5: 'skin' is cut off by the border of the image, its outline open"):
        changed(cut).outline("skin", 5)
    image = LabelMap.of_image(vein_stack())
    with pytest.raises(GeometryError, match="slice 4: 'tibia' is not there: label it in this slice"):
        image.section(4)
    with pytest.raises(GeometryError, match="no voxel has the label 6 of 'lumen_2', there are 0, 1, 5: label it"):
        image.vein("lumen_2")
    with pytest.raises(GeometryError, match="there is no slice 8: the image has 0 to 7"):
        image.section(8)
    with pytest.raises(GeometryError, match="'femur' is not a known name of a label"):
        LabelMap.of_image(vein_stack(), {"femur": 1})
    grey = phantom_stack([{"skin": FRAME}], FRAME)[1]
    with pytest.raises(GeometryError, match="hold fractions, so it is no label map"):
        LabelMap.of_image(grey)
    (tmp_path / "text.nii").write_text("no image")
    with pytest.raises(GeometryError, match=r"text.nii' cannot be read as NIfTI, NRRD or another image"):
        LabelMap.read(tmp_path / "text.nii")


def test_refused_neighbours() -> None:
    near = Outline.circle(21.3e-3, -15e-3, 4e-3)
    parts = {"skin": ONE.skin, "tibia": ONE.tibia, "fibula": ONE.fibula, "lumen": ONE.veins[0].lumen, "lumen_2": near}
    image = LabelMap.of_image(phantom_stack([parts], ONE.skin)[0])
    sentence = r"slice 0: 'lumen' and 'lumen_2' are .* mm apart, two walls of 0.8 mm need 2.1 mm: choose a smaller"
    with pytest.raises(GeometryError, match=sentence):
        image.section(0)
    assert len(image.section(0, wall_thickness=0.1e-3).veins) == 2
