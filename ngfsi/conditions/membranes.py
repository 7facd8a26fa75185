"""Membranes as a condition: their forces on the boundaries of solids."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
from ngsolve import Parameter

from ngfsi.conditions.condition import Condition, Setup
from ngfsi.errors import CaseError, unknown
from ngfsi.materials.membrane import Membrane
from ngfsi.materials.solid.law import Place
from ngfsi.mesh.domain import Domain
from ngfsi.physics import terms
from ngfsi.physics.integrals import Integral, rules
from ngfsi.physics.kinematics import Kinematics


class OnBoundary(Condition):
    """A membrane on a boundary, bonded to what lies on both sides."""

    def __init__(self, domain: Domain, membrane: Membrane) -> None:
        """Prepare.

        Raises:
            CaseError: there is no such boundary, or it is one of blood alone.
        """
        names = [*domain.geometry.boundary_names, *domain.geometry.internal_names]
        known = [name for name in names if name in domain.mesh.GetBoundaries() and name not in domain.ends]
        if membrane.on not in known:
            raise CaseError(f"materials.membranes: {unknown('boundary', membrane.on, known)}")
        if domain.mesh.dim == 2:
            raise CaseError("materials.membranes are for solids in 3-D")
        self.name, self._domain, self._membrane = f"membrane on {membrane.on}", domain, membrane

    def attach(self, setup: Setup) -> None:
        super().attach(setup)
        if setup.small:
            raise CaseError("materials.membranes have no small strain: use conditions.strain = 'finite'")
        place = Place(self._domain, self._membrane.on, setup.unknowns.order, ng.Id(3), Parameter(0.0),
                      lambda: ng.Id(3), lambda F: F)  # fmt: skip
        self._model = self._membrane.material.at(self._domain, place.region).bind(place)

    def static_integrals(self, m: Any, v: Any) -> list[Integral]:
        given, normal = self._membrane, ng.specialcf.normal(3)
        F = Kinematics(ng.Grad(m).Trace()).F
        work = terms.membrane_work(self._model, F, ng.Grad(v).Trace(), normal, given.stretch)
        measure = self._domain.ds(given.on, intrules=rules(2 * self._setup.unknowns.order))
        return [Integral([given.thickness * work], measure)]
