"""What presses on the wall of the vein from inside and from outside, along the vein."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
from ngsolve import Id, InnerProduct
from numpy.typing import NDArray

from ngfsi.domain import Vein, elements_at
from ngfsi.physics import terms
from ngfsi.physics.kinematics import Kinematics
from ngfsi.solve.system import System

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

    def __init__(self, system: System, heights: Array) -> None:
        """Prepare.

        Args:
            heights: (stations,) m
        """
        vein: Vein = system.case.geometry
        self._system, self._heights = system, heights
        self._axis = np.broadcast_to(np.array(vein.vein_centre)[:, None], (2, len(heights)))
        self.blood, self.tissue = np.zeros((2, len(heights)))
        mesh = system.domain.mesh
        space = ng.H1(mesh, order=1)  # a function of each vertex: integrals against them are local means
        face = ng.GridFunction(ng.FacetFESpace(mesh, order=0))
        face.Set(1, definedon=system.domain.boundaries("wall_outer"))
        grad_d, relaxation = ng.Grad(system.state.components[0]), system.stress_free_gradient()
        strain = Id(3) + grad_d if relaxation is None else (Id(3) + grad_d) * relaxation
        directed = Kinematics(grad_d).cof * ng.specialcf.normal(3)
        area = ng.Norm(directed)
        stress = terms.cauchy_stress(system.solids["tissue"], strain)
        pressure = -InnerProduct(directed, stress * directed) / (area * area)
        near = elements_at(system.domain, "tissue", "wall_outer")
        side = system.domain.dx("tissue", element_boundary=True, definedonelements=near)
        test = space.TestFunction()
        self._force, self._area = ng.LinearForm(space), ng.LinearForm(space)
        self._force += (face * area * pressure).Compile() * test * side
        self._area += (face * area).Compile() * test * side
        places = np.array([vertex.point[2] for vertex in mesh.vertices])
        on_face = sorted(
            {v.nr for element in system.domain.boundaries("wall_outer").Elements() for v in element.vertices}
        )
        self._vertices = np.array(on_face)
        self._levels, self._level = np.unique(places[self._vertices].round(DECIMALS), return_inverse=True)

    def refresh(self) -> None:
        """Take the system's present state."""
        x, y = self._axis
        at = self._system.domain.mesh(x, y, self._heights)
        self.blood = np.asarray(self._system.state.components[2](at)).ravel()
        sums = []
        for form in (self._force, self._area):
            form.Assemble()
            sums.append(np.bincount(self._level, form.vec.FV().NumPy()[self._vertices]))
        self.tissue = np.interp(self._heights, self._levels, sums[0] / sums[1])
