"""The blood in one state, at the points of its cells."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ngfsi.arrays import Array
from ngfsi.materials.fluid.law import FluidLaw
from ngfsi.transport.cells import Cells, Flow, deformed, gradients

SAMPLED = ("motion", "relative", "velocity")


class BloodState:
    """What scalars may depend on.

    Arrays hold one value for each integration point of the cells, (cells, points), block by block.

    Attributes:
        time: s
        fields: coefficients of the mesh's motion (m), of the relative and of the whole velocity (m/s), by block.
    """

    def __init__(
        self, cells: Cells, fluid: FluidLaw, time: float, fields: dict[str, list[Array]], *, diffusive: bool = False
    ) -> None:  # fmt: skip
        """Take a state; `diffusive`: whether something diffuses in it."""
        self.cells, self.time, self.fields, self._diffusive = cells, time, fields, diffusive
        self._fluid = fluid

    @cached_property
    def flow(self) -> Flow:
        """Volumes of the cells and flow through them."""
        return Flow.of(self.cells, self.fields["motion"], self.fields["relative"], diffusive=self._diffusive)

    @cached_property
    def shear_rates(self) -> list[Array]:
        """sqrt(2 D : D) (1/s)."""
        return [np.sqrt(np.einsum("cqij,cqij->cq", twice, twice) / 2) for twice in map(_twice_rate, self._gradients)]

    @cached_property
    def shear_stresses(self) -> list[Array]:
        """Shear rate times viscosity, that of blood that thins by its shear rate (Pa)."""
        return [np.asarray(self._fluid.viscosity_at(rate) * rate) for rate in self.shear_rates]

    @cached_property
    def _gradients(self) -> list[Array]:
        """Gradients (c, q, 3, 3) of the velocity by place (1/s)."""
        found = []
        for block, m, u in zip(self.cells.blocks, self.fields["motion"], self.fields["velocity"], strict=True):
            slopes = block.element.slopes
            cof, determinant = deformed(block.slope, slopes, m)
            found.append(gradients(slopes, u) @ cof.swapaxes(-1, -2) / determinant[..., None, None])
        return found

    @cached_property
    def places(self) -> list[Array]:
        """Where the points are (c, q, 3), m."""
        return self._moved(self.cells.places)

    def _moved(self, places: Sequence[Array]) -> list[Array]:
        return [at + np.einsum("qn,cni->cqi", block.element.values, m)
                for block, at, m in zip(self.cells.blocks, places, self.fields["motion"], strict=True)]  # fmt: skip

    @cached_property
    def wall_distances(self) -> list[Array]:
        """Distance to the wall (m): to the plane that touches it at the nearest of its points."""
        from scipy.spatial import cKDTree  # takes long to import

        cells, walls, normals = self.cells, [], []
        for block, at, m in zip(cells.blocks, cells.face_places, self.fields["motion"], strict=True):
            e = block.element
            on_wall = cells.wall[block.faces].reshape(len(block.numbers), -1)
            walls.append((at + np.einsum("fn,cni->cfi", e.face_values, m))[on_wall])
            cof = deformed(block.face_slope, e.face_slopes, m)[0]
            normals.append(np.einsum("cfij,fj->cfi", cof, e.areas)[on_wall])
        wall, normal = np.concatenate(walls), np.concatenate(normals)
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        tree = cKDTree(wall)
        found = []
        for places in self.places:
            nearest = tree.query(places)[1]
            found.append(np.abs(np.einsum("cqi,cqi->cq", places - wall[nearest], normal[nearest])))
        return found


def _twice_rate(gradient: Array) -> Array:
    return np.asarray(gradient + gradient.swapaxes(-1, -2))
