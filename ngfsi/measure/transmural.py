"""What presses on the wall of a vessel from inside and from outside, along the vessel."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
from ngsolve import InnerProduct
from numpy.typing import NDArray

from ngfsi.measure.sections import Sections
from ngfsi.measure.side import Side
from ngfsi.mesh.geometry import Vessel
from ngfsi.physics import terms
from ngfsi.system.system import System

Array = NDArray[np.float64]

DECIMALS = 9
"""Of a position in m: vertices that differ by less lie in one section."""
AROUND = 3
"""Fewest vertices around a vessel whose mesh is made of sections; where it is not, they are taken together in slices of
SLICE vertices each."""
SLICE = 12


class WallLoad:
    """Pressures along a vessel at the stations of its sections, in the reference shape.

    Attributes:
        tissue: (stations,) pressure of the tissue on the wall's outer face, -n . sigma n with the deformed normal, mean
            around the vessel, Pa: of the tissue's stress, which equals the wall's across the face.
    """

    def __init__(self, system: System, vessel: Vessel, sections: Sections, tissue: Side, region: str) -> None:
        """Prepare.

        Args:
            sections: whose stations are meant.
            tissue: the tissue's side of the wall's outer face, which is to be refreshed before.
        """
        self._heights = sections.heights
        self.tissue = np.zeros(len(sections.heights))
        mesh = system.domain.mesh
        space = ng.H1(mesh, order=1)  # a function of each vertex: integrals against them are local means
        directed = tissue.motion.cof * ng.specialcf.normal(3)
        area = ng.Norm(directed)
        stress = terms.cauchy_stress(system.solids[region], tissue.strain)
        pressure = -InnerProduct(directed, stress * directed) / (area * area)
        ds = system.domain.ds(str(vessel.outer))
        test = space.TestFunction().Trace()
        self._force, self._area = ng.LinearForm(space), ng.LinearForm(space)
        self._force += (area * pressure).Compile() * test * ds
        self._area += area.Compile() * test * ds
        on_face = sorted(
            {v.nr for element in system.domain.boundaries(str(vessel.outer)).Elements() for v in element.vertices}
        )
        self._vertices = np.array(on_face)
        places = sections.line.position(np.array([mesh.vertices[number].point for number in on_face]))
        found, self._level = np.unique(places.round(DECIMALS), return_inverse=True)
        if AROUND * len(found) > len(places):
            slices = max(len(places) // SLICE, 1)
            self._level = np.clip(places / sections.length * slices, 0, slices - 1).astype(int)
        self._levels = np.bincount(self._level, places) / np.bincount(self._level)

    def refresh(self) -> None:
        """Take the system's present state."""
        sums = []
        for form in (self._force, self._area):
            form.Assemble()
            sums.append(np.bincount(self._level, form.vec.FV().NumPy()[self._vertices]))
        self.tissue = np.interp(self._heights, self._levels, sums[0] / sums[1])
