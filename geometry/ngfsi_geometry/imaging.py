"""Between images and geometries: outlines of the labels of a segmented image, and synthetic images with known truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi, sqrt
from pathlib import Path
from typing import Any, Self

import numpy as np
from contourpy import contour_generator
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_fill_holes, binary_opening, gaussian_filter, label
from scipy.optimize import brentq

from ngfsi.errors import GeometryError, unknown
from ngfsi.mesh.geometry import COMPARTMENTS
from ngfsi.outlines.outline import Outline, closed, dense, distances, polygon_area
from ngfsi.units import from_si
from ngfsi_geometry.calf_section import NARROWEST_GAP, CalfSection, Vein
from ngfsi_geometry.loft import series
from ngfsi_geometry.lofted import LoftedVein
from ngfsi_geometry.lofted_calf import ANATOMY, FEWEST, LoftedCalf, Stack
from ngfsi_geometry.volumes import Segment, Volume, read_table, read_volume, volume_of

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Mask = NDArray[np.bool_]

PIXEL = 0.625e-3
"""Pixel size of the source study's images, m."""
SLICE = 2e-3
"""Distance of the source study's slices, m."""
MARGIN = 5e-3
SUB = 3
GREY = {"skin": 100.0, "tibia": -80.0, "fibula": -80.0, "lumen": 60.0}
"""Grey values, added up from outside inwards."""
LABELS = {
    "skin": 1, "fat": 2, "anterior": 9, "lateral": 10, "superficial_posterior": 11, "deep_posterior": 12,
    "tibia": 3, "fibula": 4, "lumen": 5, "lumen_2": 6, "lumen_3": 7, "lumen_4": 8,
}  # fmt: skip
"""Numbers in a label map, each of the voxels that lie in none of the parts inside of it; from outside inwards."""
SEPTUM, OVERLAP, BLUNT = 1, 3, 2
"""Pixels by which a compartment stays away from others, and by which its outline reaches into bones and veins, whose
own outlines then are its border; half of the width of what is too thin to count as part of it."""

LARGEST_LABEL = 2**31
Labels = Mapping[str, int | str]
SMOOTHING = 0.7
"""Width (standard deviation) of the filter that takes the stairs off a mask, in pixels, the larger ones if unequal."""
FEWEST_PIXELS = 9
FEWEST_POINTS, MOST_POINTS = 32, 240
MODES = 1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48
"""Numbers of modes that are tried."""
POINTS_OF_A_MODE = 16
FINE = 0.25
"""Distance of the points of curves that are held against each other, in pixels."""
ROUNDING = 1 / sqrt(12)
"""Standard deviation, in pixels, of a place that is rounded to pixels."""
LEVELS = 0.1, 0.9
"""Between which the level of a smoothed mask is looked for, as fractions of its largest value."""
LARGEST_AREA_ERROR = 0.05
"""Relative; outlines of parts that fall to pieces when smoothed have more."""


def phantom(outlines: Mapping[str, Outline], frame: Outline, pixel: float = PIXEL) -> Any:
    """Return a SimpleITK image (mm) of outlines by name: pixels take the fraction of each that they cover.

    Args:
        outlines: skin, and any of tibia, fibula, lumen.
        frame: outline that the image holds with a margin; the same frame makes images of one grid.
        pixel: size of the pixels, m.
    """
    import SimpleITK as sitk  # noqa: N813 - its usual name

    corner, fractions = _fractions(outlines, frame, pixel)
    image = sitk.GetImageFromArray(_grey(fractions))
    image.SetSpacing([from_si(pixel, "mm")] * 2)
    image.SetOrigin([from_si(float(c), "mm") for c in corner])
    return image


def phantom_stack(
    slices: Sequence[Mapping[str, Outline]], frame: Outline, pixel: float = PIXEL, distance: float = SLICE
) -> tuple[Any, Any]:
    """Return a label map and a grey image of a stack of sections, SimpleITK images (mm) in the patient's axes.

    Args:
        slices: outlines of each section by name, of those in LABELS, from distal to proximal; the first at z = 0.
        frame: as of `phantom`.
        pixel: size of the pixels, m.
        distance: from one slice to the next, m.
    """
    import SimpleITK as sitk  # noqa: N813 - its usual name

    sections = [_fractions(outlines, frame, pixel) for outlines in slices]
    (x, y), (rows, columns) = sections[0][0], next(iter(sections[0][1].values())).shape
    numbers = np.zeros((len(sections), rows, columns), dtype=np.uint8)
    for layer, (_, fractions) in zip(numbers, sections, strict=True):
        for name in sorted(fractions, key=list(LABELS).index):
            layer[fractions[name] > 0.5] = LABELS[name]
    grey = np.stack([_grey(fractions) for _, fractions in sections]).astype(np.float32)
    images = sitk.GetImageFromArray(numbers), sitk.GetImageFromArray(grey)
    for image in images:
        # SimpleITK's patient axes run left, posterior, up
        image.SetDirection([-1, 0, 0, 0, -1, 0, 0, 0, 1])
        image.SetSpacing([from_si(pixel, "mm")] * 2 + [from_si(distance, "mm")])
        image.SetOrigin([-from_si(float(x), "mm"), -from_si(float(y), "mm"), 0.0])
    return images


def _fractions(outlines: Mapping[str, Outline], frame: Outline, pixel: float) -> tuple[Array, dict[str, Array]]:
    """Return the centre (2,) [m] of the first pixel, and for each outline the fraction of each pixel inside of it."""
    low, high = frame.points.min(axis=0) - MARGIN, frame.points.max(axis=0) + MARGIN
    size = np.ceil((high - low) / pixel).astype(int)
    fine = pixel / SUB
    x = low[0] + fine * (np.arange(SUB * size[0]) + 0.5)
    y = low[1] + fine * (np.arange(SUB * size[1]) + 0.5)
    places, blocks = np.stack(np.meshgrid(x, y), axis=-1), (size[1], SUB, size[0], SUB)
    inside = {name: outline.contains(places).reshape(blocks) for name, outline in outlines.items()}
    return low + pixel / 2, {name: mask.mean(axis=(1, 3)) for name, mask in inside.items()}


def _grey(fractions: Mapping[str, Array]) -> Array:
    """Return grey values: all veins are as bright, what has no value of its own is as what is around it."""
    return np.asarray(sum(GREY.get(_kind(name), 0.0) * fraction for name, fraction in fractions.items()))


def _kind(name: str) -> str:
    return "lumen" if name.startswith("lumen") else name


@dataclass(frozen=True)
class LabelMap:
    """A segmented image in the axes of the geometries: x lateral, y anterior, z proximal.

    Attributes:
        numbers: label of each voxel, shape (slices, rows along y, columns along x); 0: outside of the leg.
        origin, spacing: centre of the first voxel, and distances of the voxels, (x, y, z) [m].
        labels: name -> number in the image: skin (what is in nothing else), tibia, fibula, fat, lumen, lumen_2, ...
        shift: of each slice against the one before (x, y) [m].
    """

    numbers: NDArray[np.int64]
    origin: tuple[float, float, float]
    spacing: tuple[float, float, float]
    labels: Mapping[str, int]
    shift: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def read(cls, path: Path, labels: Labels | None = None, table: Path | None = None) -> Self:
        """Return the label map in a file (NIfTI, NRRD, MetaImage ...) or in a folder with one DICOM series.

        Args:
            labels: name -> number in the image, or name that the image or the table gives it; None: the segments that
                have our names or that of a vein, without any names LABELS.
            table: file with names of the numbers.

        Raises:
            GeometryError: there is no such image, its voxels hold no whole numbers, slices are missing, or names.
        """
        volume = read_volume(path)
        try:
            return cls._of(volume, labels, read_table(table) if table else volume.segments)
        except GeometryError as error:
            raise GeometryError(f"'{path}': {error}") from None

    @classmethod
    def of_image(cls, image: Any, labels: Labels | None = None) -> Self:
        """Return the label map in a SimpleITK image (mm); labels as of `read`.

        Raises:
            GeometryError: it has not three dimensions, or its voxels hold no whole numbers.
        """
        volume = volume_of(image)
        return cls._of(volume, labels, volume.segments)

    @classmethod
    def _of(cls, volume: Volume, labels: Labels | None, segments: Sequence[Segment]) -> Self:
        values = volume.values
        whole = np.issubdtype(values.dtype, np.integer)
        if not (whole or (np.all(np.isfinite(values)) and np.array_equal(values, np.round(values)))):
            raise GeometryError("the voxels hold fractions, so it is no label map: give the segmentation of the image")
        if not whole and np.max(np.abs(values), initial=0) > LARGEST_LABEL:
            raise GeometryError("the voxels hold numbers beyond those of labels: give the segmentation of the image")
        if labels is None:
            labels = _own_names(segments) or LABELS
        for name in labels:
            if _kind(name) not in LABELS:
                raise GeometryError(unknown("name of a label", name, LABELS))
        parts = {name: _segment(given, segments) for name, given in labels.items()}
        numbers = values.astype(np.int64)
        if numbers.ndim == 4:
            numbers, parts = _flattened(numbers, parts)
        found = {name: part.number for name, part in parts.items()}
        return cls(numbers, volume.origin, volume.spacing, found, volume.shift)

    @property
    def heights(self) -> Array:
        """Positions z (slices,) [m] of the slices, from distal to proximal."""
        return np.asarray(self.origin[2] + self.spacing[2] * np.arange(len(self.numbers)), dtype=np.float64)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the labels that the image has."""
        there = np.unique(self.numbers)
        return tuple(name for name, number in self.labels.items() if number in there)

    def names_at(self, points: Array) -> NDArray[np.str_]:
        """Return the name of the label of the voxel nearest to points (n, 3) [m]; empty: of none."""
        z = np.rint((points[:, 2] - self.origin[2]) / self.spacing[2]).astype(int)
        layer = np.clip(z, 0, len(self.numbers) - 1)
        found = np.full(len(points), "", dtype=object)
        places = [np.rint((points[:, axis] - self.origin[axis] - layer * self.shift[axis]) / self.spacing[axis])
                  for axis in (0, 1)]  # fmt: skip
        column, row = (np.clip(p.astype(int), 0, n - 1) for p, n in zip(places, self.numbers.shape[:0:-1], strict=True))
        numbers = self.numbers[layer, row, column]
        for name, number in self.labels.items():
            found[numbers == number] = name
        return found.astype(str)

    def volume(self, name: str, slices: slice) -> float:
        """Return the volume [m3] of a label between the middles of the first and last of some slices."""
        areas = np.sum(self.numbers[slices] == self._number(name), axis=(1, 2)) * self._pixel_area
        return float(np.trapezoid(areas, dx=self.spacing[2]))

    def slices_of(self, name: str) -> range:
        """Return the numbers of the slices, from 0, from the first to the last in which a label is.

        Raises:
            GeometryError: the label is unknown or nowhere, or missing from slices between.
        """
        there = np.flatnonzero(np.any(self.numbers == self._number(name), axis=(1, 2)))
        if not len(there):
            there_are = ", ".join(map(str, np.unique(self.numbers)))
            raise GeometryError(
                f"no voxel has the label {self._number(name)} of '{name}', there are {there_are}: label it, or say "
                "which number it has"
            )
        gaps = np.setdiff1d(np.arange(there[0], there[-1] + 1), there)
        if len(gaps):
            raise GeometryError(
                f"slice {gaps[0]} is empty of '{name}', which lies in slices {there[0]} to {there[-1]}: label it there "
                "or leave out the slices beyond"
            )
        return range(int(there[0]), int(there[-1]) + 1)

    def outline(self, name: str, number: int) -> Outline:
        """Return the smooth outline of a part in slice `number` (from 0), of the area and centroid of its pixels.

        It is the series with the fewest modes that lies as near to the edge of the pixels as rounding to pixels would
        move it: nowhere farther than one pixel. Parts of which none does are not seen whole from their middle, as a
        crescent: theirs is a level line of the mask, smoothed by a Gaussian, that encloses the same area.

        Raises:
            GeometryError: the part is not there, too small, cut off by the image's border or in pieces.
        """
        if not 0 <= number < len(self.numbers):
            raise GeometryError(f"there is no slice {number}: the image has 0 to {len(self.numbers) - 1}")
        mask = self._mask(name, number)
        where = f"slice {number}: '{name}'"
        if not mask.any():
            raise GeometryError(f"{where} is not there: label it in this slice or choose another")
        if mask.sum() < FEWEST_PIXELS:
            raise GeometryError(f"{where} has {mask.sum()} pixels, too few for an outline: {FEWEST_PIXELS} are needed")
        if mask[[0, -1]].any() or mask[:, [0, -1]].any():
            raise GeometryError(
                f"{where} is cut off by the border of the image, its outline open: choose another slice"
            )
        pieces, count = label(mask, structure=np.ones((3, 3)))
        if count > 1:
            areas = self._pixel_area * np.sort(np.bincount(pieces.ravel())[1:])[::-1]
            listed = " and ".join(f"{from_si(float(area), 'mm2'):.1f}" for area in areas[:2])
            raise GeometryError(
                f"{where} is in {count} pieces, the largest of {listed} mm2: remove the smaller ones or give each "
                "vein a label of its own"
            )
        line = self._level_line(mask, number)
        area = self._pixel_area * float(mask.sum())
        if line is None or abs(line.area / area - 1) > LARGEST_AREA_ERROR:
            raise GeometryError(f"{where} hangs together by corners of pixels: widen it there or make it two parts")
        pixel, middle = max(self.spacing[:2]), self._middle(mask, number)
        edge = self._edge(mask, number)
        rows = line.harmonics((middle[0], middle[1]), MODES[-1])
        for modes in MODES:
            ring = _star(rows[: modes + 1], area, middle, max(FEWEST_POINTS, POINTS_OF_A_MODE * modes))
            if ring is None:
                continue
            away = distances(dense(closed(ring), FINE * pixel), edge)
            if away.max() <= pixel and np.sqrt(np.mean(away**2)) <= ROUNDING * pixel:
                return Outline.through(ring)
        return line

    def _middle(self, mask: Mask, number: int) -> Array:
        """Return the centroid (x, y) [m] of pixels."""
        x, y = self._axes(mask, number)
        rows, columns = np.nonzero(mask)
        return np.array([x[columns].mean(), y[rows].mean()])

    def edge(self, name: str, number: int) -> Array:
        """Return points (n, 2) [m] of the edge of a part's pixels in slice `number` (from 0)."""
        return self._edge(self._mask(name, number), number)

    def _edge(self, mask: Mask, number: int) -> Array:
        lines = contour_generator(*self._axes(mask, number), mask.astype(float)).lines(0.5)
        return np.vstack([dense(np.asarray(line), FINE * max(self.spacing[:2])) for line in lines])

    def _axes(self, mask: Mask, number: int) -> tuple[Array, Array]:
        """Return the places x, y [m] of the pixels of a slice."""
        (x, y, _), (dx, dy, _) = self.origin, self.spacing
        x, y = x + number * self.shift[0], y + number * self.shift[1]
        return np.asarray(x + dx * np.arange(mask.shape[1])), np.asarray(y + dy * np.arange(mask.shape[0]))

    def section(self, number: int, wall_thickness: float = 0.8e-3, **more: Any) -> CalfSection:
        """Return the cross-section in slice `number` (from 0) with all veins that are in it.

        Args:
            wall_thickness: of each vein [m]; walls are thinner than voxels.
            more: further values of the section, e.g. `mesh`.

        Raises:
            GeometryError: a part is missing or cannot be outlined, or veins are nearer than their walls.
        """
        if not 0 <= number < len(self.numbers):
            raise GeometryError(f"there is no slice {number}: the image has 0 to {len(self.numbers) - 1}")
        outlines: dict[str, Any] = {name: self.outline(name, number) for name in ("skin", "tibia", "fibula")}
        if self._has("fat", number):
            outlines["fascia"] = self.outline("fat", number)
        outlines |= {name: self.outline(name, number) for name in COMPARTMENTS if self._has(name, number)}
        lumens = [name for name in self.labels if _kind(name) == "lumen" and self._has(name, number)]
        if not lumens:
            raise GeometryError(f"slice {number}: there is no 'lumen', of label {self._number('lumen')}: label a vein")
        veins = {name: self.outline(name, number) for name in lumens}
        self._check_apart(veins, number, wall_thickness)
        try:
            parts = tuple(Vein(lumen=lumen, wall_thickness=wall_thickness) for lumen in veins.values())
            return CalfSection(veins=parts, **outlines, **more)
        except GeometryError as error:
            raise GeometryError(f"slice {number}: {error}") from None

    def vein(self, name: str = "lumen", **more: Any) -> LoftedVein:
        """Return the rigid vein through all slices in which a lumen is; `more`: further values, e.g. `mesh`.

        Raises:
            GeometryError: slices are empty or cannot be outlined, or the stack makes no vein.
        """
        there = self.slices_of(name)
        if len(there) < 4:
            raise GeometryError(f"'{name}' lies in {len(there)} slices: a lofted vein needs 4, label it in more")
        outlines = tuple(self.outline(name, number) for number in there)
        heights = tuple(map(float, self.heights[there.start : there.stop]))
        try:
            return LoftedVein(outlines=outlines, heights=heights, **more)
        except GeometryError as error:
            raise GeometryError(f"'{name}' from slice {there.start} on: {error}") from None

    def stack(
        self,
        lumen: str = "lumen",
        first: int | None = None,
        last: int | None = None,
        further: Sequence[str] = (),
    ) -> Stack:
        """Return the outlines of skin, bones and veins in slices `first` to `last`, by default all that have the vein.

        Args:
            lumen: name of the first vein.
            further: names of the others; those not named count as tissue.

        Raises:
            GeometryError: a part is missing from a slice or cannot be outlined.
        """
        there = self.slices_of(lumen)
        chosen = range(there.start if first is None else first, (there.stop - 1 if last is None else last) + 1)
        if not len(chosen) or chosen.start < 0 or chosen.stop > len(self.numbers):
            raise GeometryError(
                f"there are no slices {chosen.start} to {chosen.stop - 1}: the image has 0 to {len(self.numbers) - 1}"
            )
        if len(chosen) < FEWEST:
            raise GeometryError(
                f"'{lumen}' lies in slices {chosen.start} to {chosen.stop - 1}: a lofted calf needs {FEWEST}, label it "
                "in more"
            )
        labels = {name: lumen if name == "lumen" else name for name in ANATOMY}
        labels |= {f"lumen_{k}": name for k, name in enumerate(further, start=2)}
        outlines = {name: tuple(self.outline(title, k) for k in chosen) for name, title in labels.items()}
        return Stack(outlines, tuple(map(float, self.heights[chosen.start : chosen.stop])), chosen.start)

    def calf(
        self,
        lumen: str = "lumen",
        first: int | None = None,
        last: int | None = None,
        further: Sequence[str] = (),
        **more: Any,
    ) -> LoftedCalf:
        """Return the calf segment through slices; arguments as of `stack`, and `more`: e.g. `mesh`.

        Raises:
            GeometryError: slices are missing or cannot be outlined, or the stack makes no calf.
        """
        stack = self.stack(lumen, first, last, further)
        outlines = {name: stack.outlines[name] for name in ANATOMY}
        others = tuple(stack.outlines[name] for name in stack.lumens[1:])
        given = {"heights": stack.heights, "first_slice": stack.first, "further_lumens": others, **outlines}
        return LoftedCalf(**{**given, **more})

    @property
    def _pixel_area(self) -> float:
        return self.spacing[0] * self.spacing[1]

    def _number(self, name: str) -> int:
        if name not in self.labels:
            raise GeometryError(unknown("label", name, self.labels))
        return self.labels[name]

    def _has(self, name: str, number: int) -> bool:
        return name in self.labels and bool(np.any(self.numbers[number] == self.labels[name]))

    def _mask(self, name: str, number: int) -> Mask:
        """Return the pixels inside the outline of a part: of the skin all, of the fat what it surrounds (fascia).

        Of a compartment also the next pixels of bones and veins, but not those next to another compartment.
        """
        layer, mine = self.numbers[number], self._number(name)
        if name in ("skin", "fat"):
            body = np.asarray(binary_fill_holes(np.isin(layer, list(self.labels.values()))))
            return body & (layer != mine) if name == "fat" else body
        if name in COMPARTMENTS:
            others = [self.labels[other] for other in COMPARTMENTS if other != name and other in self.labels]
            inner = [n for other, n in self.labels.items() if _kind(other) in ("tibia", "fibula", "lumen")]
            grown = binary_dilation(layer == mine, iterations=OVERLAP) & np.isin(layer, [mine, *inner])
            apart = binary_fill_holes(grown & ~binary_dilation(np.isin(layer, others), iterations=SEPTUM))
            apart = binary_opening(apart, iterations=BLUNT)  # wedges along a bone could not be meshed
            whole = layer == mine
            if label(whole, structure=np.ones((3, 3)))[1] > 1:
                return np.asarray(whole)  # for the sentence about pieces
            # what others cut off at its corners is septum
            pieces, _ = label(apart)
            return np.asarray(pieces == 1 + np.argmax(np.bincount(pieces.ravel())[1:])) if apart.any() else whole
        return np.asarray(binary_fill_holes(layer == mine))

    def _level_line(self, mask: Mask, number: int) -> Outline | None:
        """Return the level line of the smoothed mask, in one piece, that encloses the area of its pixels, if any."""
        dx, dy, _ = self.spacing
        width = SMOOTHING * max(dx, dy)
        grey = gaussian_filter(mask.astype(float), (width / dy, width / dx))
        lines = contour_generator(*self._axes(mask, number), grey / grey.max()).lines
        target = float(mask.sum()) * self._pixel_area

        def longest(level: float) -> Array:
            rings: list[Array] = [np.asarray(line) for line in lines(level)]
            return max(rings, key=len)

        def excess(level: float) -> float:
            return polygon_area(longest(level)) - target

        if excess(LEVELS[0]) * excess(LEVELS[1]) > 0:
            return None
        ring = longest(brentq(excess, *LEVELS, xtol=1e-6))[:-1]
        arc = np.r_[0.0, np.cumsum(np.hypot(*np.diff(closed(ring), axis=0).T))]
        count = int(np.clip(arc[-1] / max(dx, dy), FEWEST_POINTS, MOST_POINTS))
        at = arc[-1] * np.arange(count) / count
        return Outline.through(np.column_stack([np.interp(at, arc, np.r_[c, c[0]]) for c in ring.T]))

    def _check_apart(self, veins: Mapping[str, Outline], number: int, wall_thickness: float) -> None:
        named = list(veins.items())
        for k, (name, lumen) in enumerate(named):
            for other, its in named[k + 1 :]:
                gap, needed = lumen.distance_to(its), 2 * wall_thickness + NARROWEST_GAP
                if gap < needed:
                    raise GeometryError(
                        f"slice {number}: '{name}' and '{other}' are {from_si(gap, 'mm'):.2g} mm apart, two walls of "
                        f"{from_si(wall_thickness, 'mm'):.2g} mm need {from_si(needed, 'mm'):.2g} mm: choose a smaller "
                        "wall_thickness or give both the same label"
                    )


def _star(row: Complex, area: float, centroid: Array, count: int) -> Array | None:
    """Return points (count, 2) [m] of a series of squared distances over the angle, with the area [m2] and centroid [m]
    that are given; None if it does not wind around its middle."""
    squares = series(row, count)
    if np.min(squares) <= 0:
        return None
    radii = np.sqrt(squares)
    rays = np.exp(2j * pi * np.arange(count) / count)
    middle = 2 / 3 * np.mean(radii**3 * rays) / np.mean(squares)
    points = np.sqrt(area / (pi * row[0].real)) * (radii * rays - middle) + complex(*centroid)
    return np.column_stack([points.real, points.imag])


def _segment(given: int | str, segments: Sequence[Segment]) -> Segment:
    """Return the segment of a number, or of a name, in capitals or not."""
    same = [s for s in segments if (s.number == given if isinstance(given, int) else s.name == given)]
    same = same or [s for s in segments if isinstance(given, str) and s.name.lower() == given.lower()]
    if len(same) == 1:
        return same[0]
    if isinstance(given, int):
        if same:
            raise GeometryError(f"several segments have the number {given}, in layers: give their names in `labels`")
        return Segment("", given)
    if not segments:
        raise GeometryError(f"the image has no names, so '{given}' cannot be found: give numbers, or a `label_table`")
    raise GeometryError(unknown("segment", given, [s.name for s in segments]))


def _own_names(segments: Sequence[Segment]) -> dict[str, int | str]:
    """Return our names of the segments that have them, and of veins in their order."""
    found: dict[str, int | str] = {}
    veins = 0
    for segment in segments:
        name = segment.name.strip().lower().replace(" ", "_")
        if "vein" in name.split("_"):
            veins += 1
            name = "lumen" if veins == 1 else f"lumen_{veins}"
        if _kind(name) in LABELS and name not in found:
            found[name] = segment.name
    return found


def _flattened(layers: NDArray[np.int64], parts: Mapping[str, Segment]) -> tuple[Any, dict[str, Segment]]:
    """Return one layer of numbers, in which inner parts are above outer ones, and the numbers of the parts in it."""
    order = list(LABELS)
    flat, found = np.zeros(layers.shape[:3], dtype=np.int64), {}
    for number, name in enumerate(sorted(parts, key=lambda name: order.index(_kind(name))), start=1):
        part = parts[name]
        if not 0 <= part.layer < layers.shape[3]:
            raise GeometryError(f"there is no layer {part.layer}, of '{part.name}': the image has {layers.shape[3]}")
        flat[layers[..., part.layer] == part.number] = number
        found[name] = part._replace(number=number)
    return flat, found


def read_image(path: Path) -> Any:
    """Return the SimpleITK image (mm) in a file, or in a folder with one DICOM series, in the axes of the geometries.

    Raises:
        GeometryError: there is no such image, it is no volume, or slices are missing.
    """
    import SimpleITK as sitk  # noqa: N813 - its usual name

    volume = read_volume(path)
    if volume.values.ndim > 3:
        raise GeometryError(f"'{path}': an image has one number in each voxel: save it so")
    image = sitk.GetImageFromArray(np.ascontiguousarray(volume.values))
    image.SetSpacing([from_si(length, "mm") for length in volume.spacing])
    image.SetOrigin([from_si(length, "mm") for length in volume.origin])
    return image
