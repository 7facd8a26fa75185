"""Force of the fluid on what it flows around."""

from __future__ import annotations

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array
from ngfsi.physics import terms
from ngfsi.physics.kinematics import Kinematics
from ngfsi.system.system import System


class Force:
    """Resultant of pressure and viscous stress on boundaries of the deformed fluid.

    It is what the fluid's momentum balance lacks when tested with a unit motion of the boundary, and not an integral
    of stresses there: consistent with the balance, and of twice the order of convergence (John and Matthies, IJNMF 37,
    2001). Where a rigid boundary meets the chosen ones, the motion fades over one layer of its elements; the traction
    on them, which does not belong to the force, is integrated and taken out.
    """

    def __init__(self, system: System, *boundaries: str) -> None:
        self._system = system
        self._form = system.blood_form()
        self._residual = system.state.vec.CreateVector()
        region, dim = system.domain.boundaries(*boundaries), system.domain.mesh.dim
        test = ng.GridFunction(system.unknowns.space)
        self._motions, self._neighbours = [], []
        others = [name for name in system.domain.geometry.rigid_names if name not in boundaries]
        traction = self._traction()
        for unit in np.eye(dim):
            test.components[0].Set(ng.CF(tuple(unit)), definedon=region)
            self._motions.append(np.array(test.vec.FV().NumPy()))
            fading = ng.GridFunction(test.space.components[0])
            fading.vec.data = test.components[0].vec
            for name in others:
                if ng.Integrate(fading * fading * system.domain.ds(name), system.domain.mesh) > 0:
                    measure = system.domain.ds(name, bonus_intorder=system.unknowns.order)
                    self._neighbours.append((len(self._motions) - 1, ng.InnerProduct(traction, fading) * measure))

    def __call__(self) -> Array:
        """Return the force (N; per metre of depth in the plane) of the present state."""
        self._form.Apply(self._system.state.vec, self._residual)
        lacking = self._residual.FV().NumPy()
        force = np.array([-float(np.dot(lacking, motion)) for motion in self._motions])
        for direction, integrand in self._neighbours:
            force[direction] += ng.Integrate(integrand, self._system.domain.mesh)
        return force

    def _traction(self) -> ng.CoefficientFunction:
        """Return the traction on a fixed boundary of the fluid (Pa), outward normal, per reference area."""
        system = self._system
        fields = system.fields()
        k = Kinematics(ng.BoundaryFromVolumeCF(fields.grad_motion))
        stress = terms.viscous_stress(system.blood, k, ng.BoundaryFromVolumeCF(fields.grad_velocity))
        area = k.cof * ng.specialcf.normal(system.domain.mesh.dim)
        return stress * area - fields.pressure * area
