"""Parameters of a law that vary in space: factors on its moduli, by height or from a file."""

from __future__ import annotations

from abc import abstractmethod
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Self

import ngsolve as ng
import numpy as np
from pydantic import Field, model_validator

from ngfsi.config.model import ConfigModel, tagged
from ngfsi.errors import MaterialError, NgfsiError, unknown
from ngfsi.mesh.domain import Domain
from ngfsi.units import Length


class Variation(ConfigModel):
    """A factor on a parameter of a law, as a function of the place in the given shape."""

    refusal: ClassVar[type[NgfsiError]] = MaterialError

    kind: str
    parameter: str
    """A modulus of the law, without its unit."""

    @abstractmethod
    def factor(self, domain: Domain, region: str) -> Any:
        """Return the factor as a coefficient function."""


class ByHeight(Variation):
    """A table of heights: straight between them, constant beyond."""

    kind: Literal["by_height"] = "by_height"
    z: tuple[Length, ...] = Field(min_length=2)
    """Heights, increasing."""
    factors: tuple[Annotated[float, Field(ge=0)], ...]
    """Factor at each of the heights."""

    @model_validator(mode="after")
    def _is_a_table(self) -> Self:
        if len(self.z) != len(self.factors):
            raise ValueError(f"z has {len(self.z)} values and factors {len(self.factors)}: each height needs a factor")
        if any(high <= low for low, high in pairwise(self.z)):
            raise ValueError("the heights z must increase")
        return self

    def factor(self, _domain: Domain, _region: str) -> Any:
        found = ng.CF(self.factors[0])
        for (low, high), (first, last) in zip(pairwise(self.z), pairwise(self.factors), strict=True):
            way = ng.IfPos(ng.z - low, ng.IfPos(high - ng.z, ng.z - low, high - low), 0.0)
            found += (last - first) / (high - low) * way
        return found


class FromFile(Variation):
    """An array of numbers in a VTU file (m), of points, between which it is interpolated, or of cells: in each element
    that of the nearest cell."""

    kind: Literal["vtu"] = "vtu"
    file: str
    """Lies beside the case file unless its path is absolute."""
    array: str
    """Name of the array."""

    def factor(self, domain: Domain, region: str) -> Any:
        import pyvista
        from scipy.spatial import cKDTree

        try:
            grid = pyvista.read(self.file)
        except Exception as error:
            raise MaterialError(f"the factors in '{self.file}' cannot be read: {error}") from None
        on_cells, on_points = grid.cell_data, grid.point_data
        if self.array not in (*on_cells, *on_points):
            raise MaterialError(f"'{self.file}': {unknown('array of numbers', self.array, [*on_cells, *on_points])}")
        values = np.asarray((on_points if self.array in on_points else on_cells)[self.array], dtype=float)
        if values.ndim != 1 or not np.all(np.isfinite(values)) or np.min(values) < 0:
            raise MaterialError(f"array '{self.array}' of '{self.file}' holds other than factors of 0 or more")
        if self.array in on_points:
            sampled = pyvista.PolyData(domain.vertices).sample(grid)
            nearest = values[cKDTree(np.asarray(grid.points)).query(domain.vertices)[1]]
            inside = np.asarray(sampled["vtkValidPointMask"], dtype=bool)
            found = ng.GridFunction(ng.H1(domain.mesh, order=1))
            found.vec.FV().NumPy()[:] = np.where(inside, sampled[self.array], nearest)
            return found
        if region not in domain.regions:
            raise MaterialError(f"array '{self.array}' of '{self.file}' is of cells: a membrane needs one of points")
        middles = [np.mean([domain.vertices[v.nr] for v in one.vertices], axis=0) for one in domain.mesh.Elements()]
        found = ng.GridFunction(ng.L2(domain.mesh, order=0))
        found.vec.FV().NumPy()[:] = values[cKDTree(np.asarray(grid.cell_centers().points)).query(middles)[1]]
        return found


AnyVariation = Annotated[Variation, tagged("kind", ByHeight, FromFile)]
"""A variation in a case: a table with `kind`."""
