"""What presses on the wall of the vein from inside and from outside, along the vein."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import InnerProduct
from numpy.typing import NDArray

from ngfsi.measure.side import Side
from ngfsi.mesh.geometry import Vessel
from ngfsi.physics import terms
from ngfsi.system.system import System

Array = NDArray[np.float64]

DECIMALS = 9
"""Of a height in m: vertices that differ by less lie at one height."""


class WallLoad:
    """Pressures along the vein at given heights of the reference shape.

    Attributes:
        blood: (stations,) pressure of the blood on the vein's axis, Pa.
        tissue: (stations,) pressure of the tissue on the wall's outer face, -n . sigma n with the deformed normal, mean
            around the vein, Pa: of the tissue's stress, which equals the wall's across the face.
    """

    def __init__(self, system: System, vessel: Vessel, sections: Any, tissue: Side, region: str) -> None:
        """Prepare.

        Args:
            heights: (stations,) m
            tissue: the tissue's side of the wall's outer face, which is to be refreshed before.
        """
        self._system, self._heights = system, sections.heights
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
        places = np.array([vertex.point[2] for vertex in mesh.vertices])
        on_face = sorted(
            {v.nr for element in system.domain.boundaries(str(vessel.outer)).Elements() for v in element.vertices}
        )
        self._vertices = np.array(on_face)
        self._levels, self._level = np.unique(places[self._vertices].round(DECIMALS), return_inverse=True)

    def refresh(self) -> None:
        """Take the system's present state."""
        sums = []
        for form in (self._force, self._area):
            form.Assemble()
            sums.append(np.bincount(self._level, form.vec.FV().NumPy()[self._vertices]))
        self.tissue = np.interp(self._heights, self._levels, sums[0] / sums[1])
