"""Geometries of case files that name a label map."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ngfsi.arrays import Array
from ngfsi.errors import GeometryError, unknown
from ngfsi.mesh.geometry import COMPARTMENTS
from ngfsi_geometry.content import check_digest, digest
from ngfsi_geometry.imaging import LabelMap
from ngfsi_geometry.lofted_calf import PIXELS, CalfLoft, Stack


class LabelledCalf(CalfLoft):
    """Calf segment through the slices of a segmented image: NIfTI, NRRD, or a folder with a DICOM series."""

    file: str = Field(min_length=1, description="the image: NIfTI, NRRD, or a folder of DICOM")
    labels: dict[str, int | str] | None = None
    """Name -> number or name of the segment in the image: skin (what is in nothing else), tibia, fibula, lumen, and all
    others inside of the skin. Without it segments that the image names so, veins in their order, or usual numbers."""
    label_table: str | None = None
    """File that names the numbers: of ITK-SNAP or FreeSurfer, CSV with a head, or JSON."""
    vein: str = "lumen"
    """Name of the label of the vein."""
    further_veins: tuple[str, ...] = ()
    """Names of the labels of further veins, in all slices that are taken; veins not named count as tissue."""
    compartments: tuple[str, ...] = ()
    """Labels that become regions: of anterior, lateral, superficial_posterior, deep_posterior and fat. Their borders
    are faces of elements."""
    first_slice: int | None = Field(None, ge=0)
    """Numbers of the slices to be taken, from 0 from distal to proximal; default: all that have the vein."""
    last_slice: int | None = Field(None, ge=0, description="number of the last slice that is used; None: of the image")
    sha256: str = Field(default_factory=lambda given: digest(given["file"], "label map"))
    """Of the file: a case belongs to its content."""

    @cached_property
    def stack(self) -> Stack:
        """The outlines in the image."""
        return self._image.stack(self.vein, self.first_slice, self.last_slice, self.further_veins)

    @cached_property
    def _image(self) -> LabelMap:
        check_digest(self.file, "label map", self.sha256)
        return LabelMap.read(Path(self.file), self.labels, Path(self.label_table) if self.label_table else None)

    @model_validator(mode="after")
    def _compartments_are_there(self) -> Self:
        known = [name for name in (*COMPARTMENTS, "fat") if name in self._image.names]
        for name in self.compartments:
            if name not in known:
                raise GeometryError(f"compartments: {unknown('label that can be a region', name, known)}")
        if self.compartments and self.mesh.element == "csg":
            raise GeometryError("meshes of element = 'csg' have no compartments: use another element")
        return self

    @property
    def further_regions(self) -> tuple[str, ...]:
        """Names of the regions of labels."""
        return tuple(name for name in (*COMPARTMENTS, "fat") if name in self.compartments)

    @property
    def resolution(self) -> float:
        """Some pixels [m]."""
        return PIXELS * max(self._image.spacing[:2])

    def region_at(self, points: Array) -> NDArray[np.str_]:
        """Return the region at points (n, 3) [m] of the tissue: that of the label of the nearest voxel."""
        middle = self._middle_of_skin
        labels = self._image.names_at(points + np.array([middle.real, middle.imag, self.stack.heights[0]]))
        return np.where(np.isin(labels, self.further_regions), labels, "tissue")

    def label_volumes(self) -> dict[str, float]:
        """Return the volumes [m3] of the labels that are regions, between the middles of the first and last slices."""
        chosen = slice(self.stack.first, self.stack.first + len(self.stack.heights))
        return {name: self._image.volume(name, chosen) for name in self.further_regions}

    def edge(self, part: str, number: int) -> Array:
        """Return points (n, 2) [m] of the edge of a part's pixels in one of the slices, from 0."""
        veins = dict(zip(self.stack.lumens, (self.vein, *self.further_veins), strict=True))
        return self._image.edge(veins.get(part, part), self.stack.first + number)
