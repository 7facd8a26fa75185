"""Energies and powers of the whole system: what goes in is stored, moves, is dissipated, or leaves.

d/dt (stored + kinetic) = power of the skin's pressure + power through inlet and outlet - dissipation, with the kinetic
energy that the blood carries through the openings in their powers. The solution of the coupled system obeys that up to
two errors, and to no others: that of div u = 0, which holds only against the functions of the pressure and lets
convection make the power `excess`; and that of the time scheme, which takes `rate` for the rate of the energy. At each
instant rate = power of skin and flow - dissipation + excess, to quadrature.
"""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import InnerProduct

from ngfsi.mesh.domain import Domain
from ngfsi.physics import terms
from ngfsi.physics.kinematics import Kinematics
from ngfsi.system.system import System


class Energy:
    """Energies (J) and powers (W) of a system's present state."""

    def __init__(self, system: System) -> None:
        self.system = system
        domain, order = system.domain, system.unknowns.order
        self._stored = self._stored_energy(domain)
        fields = system.fields(system.state.components)
        k = Kinematics(fields.grad_motion)
        u, rho = fields.velocity, system.blood_density
        fluid = domain.dx(domain.fluid, bonus_intorder=2 * order)
        motion_rate = system.new_weight * system.state.components[0] + system.velocity_history.components[0]
        blood = system.blood
        self._kinetic = [rho / 2 * k.J * InnerProduct(u, u) * fluid] + [
            law.density / 2 * InnerProduct(motion_rate, motion_rate) * domain.dx(name)
            for name, law in system.solids.items()
        ]
        stress = terms.viscous_stress(blood, k, fields.grad_velocity)
        self._dissipation = InnerProduct(stress * k.cof, fields.grad_velocity) * fluid
        normal = ng.specialcf.normal(domain.mesh.dim)
        self._skin = -terms.follower_pressure(system.skin_pressure, k, normal, motion_rate) * domain.ds("skin")
        acceleration = system.new_weight * motion_rate + system.acceleration_history.components[0]
        grad_rate = system.new_weight * fields.grad_motion + ng.Grad(system.velocity_history.components[0])
        self._rate = [
            rho
            * (k.J * InnerProduct(u, fields.acceleration) + InnerProduct(u, u) / 2 * InnerProduct(k.cof, grad_rate))
            * fluid
        ] + [
            (
                terms.internal_work(law, k.F, grad_rate, system.stress_free_gradient())
                + terms.inertia(law.density, acceleration, motion_rate)
            )
            * domain.dx(name)
            for name, law in system.solids.items()
        ]
        self._excess = rho / 2 * InnerProduct(u, u) * InnerProduct(k.cof, fields.grad_velocity) * fluid
        openings = domain.ds("inlet", "outlet", bonus_intorder=2 * order)
        flux = terms.relative_flux(k, fields.relative, normal)
        self._carried = rho / 2 * InnerProduct(u, u) * flux * openings
        test = system.unknowns.space.TestFunction()[0]
        self._openings = ng.LinearForm(system.unknowns.space)
        for name in system.openings:
            trace = domain.ds(name, skeleton=True, bonus_intorder=2 * order)
            self._openings += -system.opening(name, fields, k, test) * trace

    def stored(self) -> float:
        """Return the energy of tissue and wall (J)."""
        return self._sum(self._stored)

    def kinetic(self) -> float:
        """Return the kinetic energy of tissue, wall and blood (J)."""
        return self._sum(self._kinetic)

    def rate(self) -> float:
        """Return the rate of stored and kinetic energy as the time scheme has it (W)."""
        return self._sum(self._rate)

    def excess(self) -> float:
        """Return the power that convection makes where div u is not zero pointwise (W)."""
        return self._sum([self._excess])

    def dissipation(self) -> float:
        """Return the power that the blood's viscosity turns into heat (W)."""
        return self._sum([self._dissipation])

    def skin_power(self) -> float:
        """Return the power of the pressure on the skin (W)."""
        return self._sum([self._skin])

    def flow_power(self) -> float:
        """Return the power through inlet and outlet (W): of tractions, and of the kinetic energy carried in or out."""
        system = self.system
        unknowns, rates = system.unknowns, system.rates()
        velocity = np.zeros(unknowns.size)  # of the blood, as a function of the motion's space
        velocity[: unknowns.space.Range(0).stop] = rates[: unknowns.space.Range(0).stop]
        velocity[unknowns.blocks["e"]] += system.values[unknowns.blocks["w"]]
        self._openings.Assemble()
        pressed = float(np.dot(self._openings.vec.FV().NumPy(), velocity))
        # the force that makes the blood enter as prescribed is what the balance of momentum lacks there
        lacking = np.array(system.residual().FV().NumPy())[unknowns.inlet]
        inlet = float(np.dot(lacking, velocity[unknowns.equations[unknowns.inlet]]))
        return inlet + pressed - self._sum([self._carried])

    def _stored_energy(self, domain: Domain) -> list[Any]:
        F, G = Kinematics(ng.Grad(self.system.state.components[0])).F, self.system.stress_free_gradient()
        return [terms.stored_energy(law, F, G) * domain.dx(name) for name, law in self.system.solids.items()]

    def _sum(self, integrals: list[Any]) -> float:
        return float(sum(ng.Integrate(integral, self.system.domain.mesh) for integral in integrals))
