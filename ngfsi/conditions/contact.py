"""Contact of opposite sides of the lumen, without friction, by the mesh between them as a third medium."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
from pydantic import Field

from ngfsi.arrays import Array
from ngfsi.conditions.condition import Condition, Setup
from ngfsi.config.model import ConfigModel
from ngfsi.mesh.domain import Domain
from ngfsi.physics import terms
from ngfsi.physics.fields import MOTION, VELOCITY
from ngfsi.physics.integrals import Integral, rules
from ngfsi.physics.kinematics import Kinematics

EXTRA_ORDER = 2
"""Integration order of the medium beyond twice that of the elements: its energy is no polynomial."""
PRESSED = 10e3
"""Pressure (Pa) between the sides at which their distance is the residual gap: about that of a cuff at 75 mmHg."""


class ContactModel(ConfigModel):
    """How near opposite sides of the lumen come."""

    residual_gap: float = Field(default=0.02, ge=0.002, le=0.2)
    """Distance of the sides under a pressure of 10 kPa between them, over their distance at the start; that pressure
    falls with the fourth power of the distance, so that it is 16 Pa at five times the residual gap."""


class Contact(Condition):
    """Sides of the lumen that may touch.

    The mesh of the blood is a medium of its own, see `terms.contact_medium`, so soft that it is felt only where it is
    pressed to a thin layer. It is in equilibrium with the wall, which gives both the force on the wall and the motion
    of the mesh, in place of that of `discretisation.mesh_motion`. Third media: P. Wriggers, J. Schroeder and A.
    Schwarz, Comput Mech 52 (2013) 837.
    """

    name = "contact"

    def __init__(self, domain: Domain, model: ContactModel) -> None:
        self._domain = domain
        self._stiffness = PRESSED / terms.contact_pressure(model.residual_gap)

    def moves_mesh(self) -> bool:
        return True

    def attach(self, setup: Setup) -> None:
        """Take what it acts on, and the points of the lumen where the distance of its sides is looked at."""
        super().attach(setup)
        self._ratio = Kinematics(ng.Grad(setup.state[MOTION])).J
        lumens = self._domain.materials(*self._domain.lumens)
        self._points = self._domain.mesh.MapToAllElements(rules(2 * setup.unknowns.order), lumens)

    def gaps(self) -> Array:
        """Return det F of the medium, which between parallel sides is the ratio of their distances."""
        return np.asarray(self._ratio(self._points)).ravel()

    def integrals(self, elements: ng.BitArray | None) -> list[Integral]:
        """Return the work of the medium on the wall, and its equilibrium.

        Inside of the lumen the former is the latter once more, which changes nothing. On openings, whose plane holds
        the medium, it is taken from the blood's equations again: see `Unknowns.less`.
        """
        return [*self._medium(MOTION, elements), *self.blood_integrals(elements)]

    def blood_integrals(self, elements: ng.BitArray | None) -> list[Integral]:
        return self._medium(VELOCITY, elements)

    def _medium(self, tested: str, elements: ng.BitArray | None) -> list[Integral]:
        setup, points = self._setup, rules(2 * self._setup.unknowns.order + EXTRA_ORDER)
        k, grad_v = Kinematics(ng.Grad(setup.trial[MOTION])), ng.Grad(setup.test[tested])
        dx = self._domain.dx(*self._domain.lumens, intrules=points, definedonelements=elements)
        return [Integral([self._stiffness * terms.contact_medium(k, grad_v)], dx)]
