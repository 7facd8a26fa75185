"""What presses on the wall of a vessel from inside and from outside, along the vessel."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import InnerProduct, Inv

from ngfsi.arrays import Array
from ngfsi.measure.sections import Sections
from ngfsi.physics import terms
from ngfsi.physics.kinematics import Kinematics
from ngfsi.system.system import System
from ngfsi.system.together import OnAllRanks, together
from ngfsi.system.unknowns import same_functions

DECIMALS = 9
"""Of an arc length in m: vertices that differ by less lie at one station."""
FEWEST = 3
"""Vertices of the outer face at each of its levels, on average, by which a mesh is known to have layers."""
AROUND = 2.0
"""Largest distance from the centreline of what belongs to it, over the median: others are of another branch."""


class Side:
    """What a solid is subject to at its boundary; `refresh` after each step.

    The displacement lives on both sides of a face between solids, where a boundary value of its gradient would be that
    of either side. It is therefore carried over to a field that exists in the one solid alone, exactly, since that lies
    in the same space there.

    Attributes:
        motion: kinematics of the deformation, as boundary values.
        strain: deformation gradient from the shape that is free of stress, as boundary values: what the law sees.
    """

    def __init__(self, system: System, region: str) -> None:
        """Prepare.

        Args:
            region: the solid.
        """
        space = ng.VectorH1(system.domain.mesh, order=system.unknowns.order, definedon=region)
        here = same_functions(system.domain, space, system.unknowns.space.components[0], region)
        self._there, self._numbers = np.flatnonzero(here >= 0), here[here >= 0]
        fields = [field for field in (system.motion, system.relaxation) if field is not None]
        self._copies = [(field, ng.GridFunction(space)) for field in fields]
        self.motion, *relaxation = (Kinematics(ng.BoundaryFromVolumeCF(ng.Grad(copy))) for _, copy in self._copies)
        self.strain: Any = self.motion.F * Inv(relaxation[0].F) if relaxation else self.motion.F

    def refresh(self) -> None:
        """Take the system's present state."""
        for field, copy in self._copies:
            copy.vec.FV().NumPy()[self._there] = field.vec.FV().NumPy()[self._numbers]


class WallLoad(OnAllRanks):
    """Pressures along a vessel at given stations of the reference shape.

    Attributes:
        tissue: (stations,) pressure of the tissue on the wall's outer face, -n . sigma n with the deformed normal, mean
            around the vessel, Pa: of the tissue's stress, which equals the wall's across the face.
    """

    def __init__(self, system: System, sections: Sections, tissue: Side, region: str) -> None:
        """Prepare.

        Args:
            sections: whose stations are taken.
            tissue: the tissue's side of the vessel's outer face, which is to be refreshed before.
            region: of the tissue.
        """
        super().__init__(system)
        self._stations = sections.stations
        self.tissue = np.zeros(len(self._stations))
        outer = str(sections.vessel.outer)
        mesh = system.domain.mesh
        space = ng.H1(mesh, order=1)  # a function of each vertex: integrals against them are local means
        directed = tissue.motion.cof * ng.specialcf.normal(3)
        area = ng.Norm(directed)
        stress = terms.cauchy_stress(system.solids[region], tissue.strain)
        pressure = -InnerProduct(directed, stress * directed) / (area * area)
        ds = system.domain.ds(outer, definedonelements=system.mine(ng.BND))
        test = space.TestFunction().Trace()
        self._forms = [ng.LinearForm(space) for _ in range(2)]
        self._forms[0] += (area * pressure).Compile() * test * ds
        self._forms[1] += area.Compile() * test * ds
        vertices = system.domain.vertices_on(outer)
        points = system.domain.vertices[vertices]
        along = sections.line.coordinate(points)
        away = np.linalg.norm(points - sections.line.points(along), axis=1)
        near = away < AROUND * np.median(away)
        self._vertices, along = vertices[near], along[near]
        levels, self._level = np.unique(along.round(DECIMALS), return_inverse=True)
        if len(levels) > len(along) / FEWEST:  # without layers: what is nearest to each station
            nearest = np.argmin(np.abs(along[:, None] - self._stations), axis=1)
            _, self._level = np.unique(nearest, return_inverse=True)
            levels = np.bincount(self._level, along) / np.bincount(self._level)
        self._levels = levels

    def refresh(self) -> None:
        """Take the system's present state."""
        sums = self._sums()
        self.tissue = np.interp(self._stations, self._levels, sums[0] / sums[1])

    @together
    def _sums(self) -> Array:
        """Return the integrals (2, levels) of pressure and area."""
        sums = np.empty((2, len(self._levels)))
        for form, found in zip(self._forms, sums, strict=True):
            form.Assemble()
            found[:] = np.bincount(self._level, form.vec.FV().NumPy()[self._vertices])
        self.system.ranks.add(sums)
        return sums
