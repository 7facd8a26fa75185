"""Energies and powers of the whole system: what goes in is stored, moves, is dissipated, or leaves.

d/dt (stored + kinetic) = sum of the powers of all conditions - dissipation - kinetic energy carried out through the
openings. The power of a condition is that of its own terms of the weak form, tested with the velocity; where it
prescribes unknowns, that of the force which the balance of momentum lacks there. The solution of the coupled system
satisfies the balance up to two errors: that of div u = 0, which holds only against the functions of the pressure and
lets convection make the power `excess`; and that of the time scheme, which takes `rate` for the rate of the energy. At
each instant rate = powers - carried - dissipation + excess, to quadrature.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import InnerProduct

from ngfsi.arrays import Array
from ngfsi.conditions import Condition, PressureOn
from ngfsi.physics import terms
from ngfsi.physics.kinematics import Kinematics
from ngfsi.system.forms import residual_form
from ngfsi.system.system import System

DIFFERENCE = 1e-3
"""Time over which energies are compared for their rate, over that of the scheme."""


class Energy:
    """Energies (J) and powers (W) of a system's present state; per metre of depth in the plane."""

    def __init__(self, system: System) -> None:
        self.system = system
        domain, order = system.domain, system.unknowns.order
        rate = system.new_weight * system.motion + system.velocity_history.components[0]
        F, G = Kinematics(ng.Grad(system.motion)).F, system.stress_free_gradient()
        self._stored = [terms.stored_energy(model, F, G) * domain.dx(n) for n, model in system.solids.items()]
        self._kinetic = [m.density / 2 * InnerProduct(rate, rate) * domain.dx(n) for n, m in system.solids.items()]
        self._heat: list[Any] = []
        self._held: list[Any] = []
        self._holding: list[Any] = []
        volume = 1.0 if G is None else ng.Det(G)
        for name, model in system.solids.items():
            if held := model.held():
                dx = domain.dx(name, bonus_intorder=2 * order)
                self._held.append(held.energy / volume * dx)
                self._holding.append(held.rate / volume * dx)
                self._heat.append(held.dissipation / volume * dx)
        self._excess: list[Any] = []
        self._carried: list[Any] = []
        if domain.lumens:
            f, rho = system.fields(), system.blood_density
            k, u = Kinematics(f.grad_motion), f.velocity
            energy, blood = rho / 2 * InnerProduct(u, u), domain.dx(*domain.lumens, bonus_intorder=2 * order)
            stress = terms.viscous_stress(system.blood, k, f.grad_velocity)
            self._kinetic.insert(0, k.J * energy * blood)
            self._heat.append(InnerProduct(stress * k.cof, f.grad_velocity) * blood)
            self._excess = [energy * InnerProduct(k.cof, f.grad_velocity) * blood]
            openings = domain.ds(*(n for v in domain.vessels for n in v.openings), bonus_intorder=2 * order)
            flux = terms.relative_flux(k, f.relative, ng.specialcf.normal(domain.mesh.dim))
            self._carried = [energy * flux * openings]
        space = system.unknowns.space
        self._works = {name: residual_form(space, found) for name, condition in system.conditions.items()
                       if (found := condition.integrals(None))}  # fmt: skip

    def stored(self) -> float:
        """Return the energy of the solids, their internal variables included (J)."""
        return self._sum(self._stored) + self._sum(self._held)

    def kinetic(self) -> float:
        """Return the kinetic energy of solids and blood (J)."""
        return self._sum(self._kinetic)

    def excess(self) -> float:
        """Return the power that convection makes where div u is not zero pointwise (W)."""
        return self._sum(self._excess)

    def dissipation(self) -> float:
        """Return the power that the viscosity of blood and solids turns into heat (W)."""
        return self._sum(self._heat)

    def carried(self) -> float:
        """Return the kinetic energy that the blood carries out through the openings in a second (W)."""
        return self._sum(self._carried)

    def powers(self) -> dict[str, float]:
        """Return the power that each condition brings in (W), by its name."""
        system, unknowns, velocity = self.system, self.system.unknowns, self._velocity()
        lacking = np.array(system.residual().FV().NumPy())
        work = system.state.vec.CreateVector()
        found = {}
        for name, condition in system.conditions.items():
            power = self._of_prescribed(condition, lacking, velocity)
            if name in self._works:
                self._works[name].Apply(system.state.vec, work)
                power -= float(np.dot(unknowns.arranged(work.FV().NumPy()), velocity))
            found[name] = power
        return found

    def skin_power(self, powers: Mapping[str, float]) -> float:
        """Return the power (W) of all pressures on the skin, cuffs included, out of the powers of all conditions."""
        conditions = self.system.conditions
        return sum(power for name, power in powers.items()
                   if isinstance(one := conditions[name], PressureOn) and one.on_skin)  # fmt: skip

    def rate(self) -> float:
        """Return the rate of stored and kinetic energy as the time scheme has it (W): by a difference of energies along
        the scheme's rates of the unknowns and of their rates."""
        system = self.system
        fields = system.state, system.velocity_history
        before = [np.array(field.vec.FV().NumPy()) for field in fields]
        changes = system.rates(), np.array(system.acceleration_history.vec.FV().NumPy())
        span = DIFFERENCE / system.new_weight.Get() if system.new_weight.Get() else DIFFERENCE
        energies = []
        for side in (1, -1):
            for field, value, change in zip(fields, before, changes, strict=True):
                field.vec.FV().NumPy()[:] = value + side * span * change
            energies.append(self._sum(self._stored) + self.kinetic())
        for field, value in zip(fields, before, strict=True):
            field.vec.FV().NumPy()[:] = value
        # internal variables have rates of their own
        return (energies[0] - energies[1]) / (2 * span) + self._sum(self._holding)

    def _of_prescribed(self, condition: Condition, lacking: Array, velocity: Any) -> float:
        """Return the power of the force that makes prescribed unknowns what they are."""
        numbers = condition.prescribed()
        return float(np.dot(lacking[numbers], velocity[numbers]))

    def _velocity(self) -> Array:
        """Return the velocity of solids and blood as a function of the motion's space, by the unknowns whose equations
        are tested with it."""
        unknowns = self.system.unknowns
        velocity = np.zeros(unknowns.size)
        motion = unknowns.space.Range(0)
        velocity[: motion.stop] = self.system.rates()[: motion.stop]
        velocity[unknowns.blocks["e"]] += self.system.values[unknowns.blocks["w"]]
        return velocity[unknowns.equations]

    def _sum(self, integrals: list[Any]) -> float:
        return float(sum(ng.Integrate(integral, self.system.domain.mesh) for integral in integrals))
