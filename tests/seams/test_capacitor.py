"""An outlet with a compliance behind it, added in this file alone: an unknown of its own with a rate."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from ngsolve import IfPos

from ngfsi.conditions import Condition, OpeningModel
from ngfsi.conditions.openings import ResistiveTraction
from ngfsi.config.functions import FlowTable, PressureConstant
from ngfsi.linear.backends import choose_backend
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.geometry import Vessel
from ngfsi.physics import terms
from ngfsi.physics.integrals import Integral
from ngfsi.physics.kinematics import Kinematics
from ngfsi.solve.initial import initial_state
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.system.system import System
from ngfsi.units import Compliance
from tests.vein import TUBE, case_of, domain_of

C, FLOW, STEP = 2e-9, 2e-6, 0.05


class Capacitor(OpeningModel):
    """C dp/dt = Q, from p0 at rest."""

    kind: Literal["test_capacitor"] = "test_capacitor"
    compliance: Compliance

    def condition(self, domain: Domain, opening: str, vessel: Vessel) -> Condition:
        return Stored(domain, opening, vessel, PressureConstant(value=500.0), self.compliance)


class Stored(ResistiveTraction):
    def law(self, p: Any, q: Any) -> list[Integral]:
        setup, area = self._setup, self.domain.area(self.opening)
        rate = setup.new_weight * p + setup.velocity_history[self.unknown]
        fields, normal = setup.fields(setup.trial), self.domain.outward_normal(self.lumen)
        flux = terms.relative_flux(Kinematics(fields.grad_motion.Trace()), fields.relative.Trace(), normal)
        balance = IfPos(setup.new_weight, self.resistance * rate / area - flux, p / area)
        return [Integral([balance * q], self.domain.ds(self.opening, bonus_intorder=4))]


def test_a_flow_that_rises_fills_it() -> None:
    """In a vein that is held, Q = a t gives p - p0 = a t^2 / (2 C): BDF2 is exact for it but for its first step, of
    backward Euler, whose error a h^2 / (2 C) the scheme's other root, 1/3, turns into 3/2 (1 - 3^-n) times that."""
    changes = {
        "loads.inlet_flow": FlowTable(times=(0.0, 1.0), values=(0.0, FLOW)),
        "loads.openings": {"outlet": Capacitor(compliance=C)},
        "conditions.ends": "clamped", "time.step": STEP, "time.end": 10 * STEP,
    }  # fmt: skip
    system = System(case_of(TUBE, **changes), domain_of(TUBE))
    initial_state(system, Newton(system, choose_backend("auto")))
    blocks = [name for name in system.unknowns.blocks if name not in "de"]  # the wall stays where it is
    loop = TimeLoop(system.case, system, Newton(system, choose_backend("auto"), *blocks))
    outlet: Any = system.conditions["outlet"]
    found = [(step.time, outlet.given_pressure() - 500.0) for step in loop.run()]
    times, pressures = np.array(found).T
    exact = FLOW * times**2 / (2 * C)
    defect = (pressures - exact) / (FLOW * STEP**2 / (2 * C))
    np.testing.assert_allclose(defect, 1.5 * (1 - 3.0 ** -np.arange(1, 11)), rtol=1e-6)
