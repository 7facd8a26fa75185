"""A law with internal variables, added in this file alone: a Maxwell element beside a spring."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

import ngsolve as ng
import numpy as np
import pytest
from ngsolve import CoefficientFunction, Det, Id, IfPos, InnerProduct, exp

from ngfsi.conditions import Condition, Setup
from ngfsi.conditions.condition import ConditionModel
from ngfsi.linear.backends import choose_backend
from ngfsi.materials.solid.internal import InternalVariable
from ngfsi.materials.solid.law import Pair, Place, SolidLaw, SolidModel
from ngfsi.materials.solid.viscosity import SolidViscosity
from ngfsi.mesh.domain import Domain
from ngfsi.registry import register
from ngfsi.run import run
from ngfsi.solve.initial import initial_state
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.store import open_run
from ngfsi.system.system import System
from ngfsi.units import Pressure, Time
from tests.seams.block import SIDE, case_of, domain

STRETCH, TAU, STEP = 1.3, 0.4, 0.1


@register("ngfsi.solid_laws", "test_maxwell")
class Maxwell(SolidLaw):
    """S = S0(C) + Q, with dQ/dt + Q/tau = dS1(C)/dt (Simo, CMAME 60, 1987): exact where S1 changes evenly in a step."""

    formula: ClassVar[str] = ""
    source: ClassVar[str] = "for this test"
    law: Literal["test_maxwell"] = "test_maxwell"
    mu: Pressure = 10e3
    K: Pressure = 40e3
    viscous: Pressure = 20e3
    tau: Time = TAU

    def energies(self, F: CoefficientFunction) -> Pair:
        J = Det(F)
        return self.mu / 2 * (J ** (-2 / 3) * ng.Trace(F.trans * F) - 3), self.K / 2 * (J - 1) ** 2

    def bind(self, place: Place) -> SolidModel:
        return MaxwellModel(self, place)


class MaxwellModel(SolidModel):
    def __init__(self, law: Maxwell, place: Place) -> None:
        self.density, self._law, self._place = law.density, law, place
        space = ng.MatrixValued(ng.L2(place.mesh, order=2), 3)
        self._Q, self._S = ng.GridFunction(space), ng.GridFunction(space)
        ratio = place.step / law.tau
        resting = ratio - 1e6
        self._decay = IfPos(resting, 0.0, exp(-ratio))
        self._gain = IfPos(resting, 0.0, (1 - exp(-ratio)) / ratio)
        self._remembered = {"Q": InternalVariable(self._Q, self._over(place.F), place),
                            "S": InternalVariable(self._S, self._elastic(place.F), place)}  # fmt: skip

    def _elastic(self, F: CoefficientFunction) -> CoefficientFunction:
        return self._law.viscous * (F.trans * F - Id(3))

    def _over(self, F: CoefficientFunction) -> CoefficientFunction:
        return self._decay * self._Q + self._gain * (self._elastic(F) - self._S)

    def energies(self, F: CoefficientFunction) -> Pair:
        return self._law.energies(F)

    def variations(self, F: CoefficientFunction, H: CoefficientFunction) -> Pair:
        rest, bulk = super().variations(F, H)
        return rest + InnerProduct(F * self._over(F), H), bulk

    def variation(self, F: CoefficientFunction, H: CoefficientFunction) -> CoefficientFunction:
        return sum(self.variations(F, H))

    def internal_variables(self) -> dict[str, InternalVariable]:
        return self._remembered


@register("ngfsi.conditions", "test_stretch")
class Stretched(ConditionModel):
    """The whole surface is stretched along x within the first step, and held."""

    kind: Literal["test_stretch"] = "test_stretch"

    def condition(self, _domain: Domain, name: str) -> Condition:
        return Stretching(name)


class Stretching(Condition):
    def __init__(self, name: str) -> None:
        self.name, self._factor = name, 0.0

    def fixes(self) -> dict[str, list[str]]:
        return {"": ["skin"]}

    def attach(self, setup: Setup) -> None:
        super().attach(setup)
        space = setup.unknowns.space.components[0]
        field = ng.GridFunction(space)
        field.Set(ng.CF(((STRETCH - 1) * ng.x, 0, 0)))
        self._numbers = np.flatnonzero(list(space.GetDofs(setup.domain.boundaries("skin"))))
        self._values = np.array(field.vec.FV().NumPy()[self._numbers])

    def prescribed(self) -> Any:
        return self._numbers

    def prescribe(self, values: Any) -> None:
        values[self._numbers] = self._factor * self._values

    def update(self, t: float, _load_factor: float = 1.0) -> None:
        self._factor = min(t / STEP, 1.0)

    def state_arrays(self) -> dict[str, Any]:
        return {"factor": np.array([self._factor])}

    def restore_state(self, arrays: Mapping[str, Any]) -> None:
        self._factor = float(arrays["factor"][0])


CASE = case_of(
    Maxwell(density=1000.0), **{"loads.further": (Stretched(),), "time.step": STEP, "time.end": 6 * STEP,
                                "solver.tolerance": 1e-9, "output.checkpoint_every": 1},
)  # fmt: skip


def test_relaxation_is_exact() -> None:
    """After a stretch that grows evenly for a step h the overstress is S1 tau/h (1 - e^(-h/tau)) e^(-(t - h)/tau)."""
    cube = domain()
    system = System(CASE, cube)
    newton = Newton(system, choose_backend("auto"))
    initial_state(system, newton)
    law, E = CASE.materials.solid, ng.CF((1, 0, 0, 0, 0, 0, 0, 0, 0), dims=(3, 3))
    F = system.deformation_gradient()
    whole = system.solids["solid"].variation(F, E) * cube.dx("solid")
    spring = law.variation(F, E) * cube.dx("solid")
    for step in TimeLoop(CASE, system, newton).run():
        over = (ng.Integrate(whole, cube.mesh) - ng.Integrate(spring, cube.mesh)) / SIDE**3
        S = law.viscous * (STRETCH**2 - 1) * TAU / STEP * (1 - np.exp(-STEP / TAU))
        assert over == pytest.approx(STRETCH * S * np.exp(-(step.time - STEP) / TAU), rel=1e-9, abs=0)


VISCOUS = CASE.replace(**{"materials.solid.viscosity": SolidViscosity(moduli=(9e3, 3e3), times=(0.3, 0.05))})
"""With ngfsi's own viscosity beside the element of this file."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run(VISCOUS, tmp_path_factory.mktemp("maxwell") / "run", quiet=True).path


def test_resumed_it_is_the_same_run(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tests.runs import assert_resumed  # not where the ranks import this file

    assert_resumed(VISCOUS, tmp_path / "run", whole, monkeypatch)


def test_two_ranks_give_the_same(whole: Path, tmp_path: Path) -> None:
    from tests.test_ranks import mpirun  # not where the ranks import this file

    file = tmp_path / "case.toml"
    file.write_text(VISCOUS.to_toml())
    # the law is in this file, and pytest not in that environment
    before = "from unittest.mock import MagicMock\nsys.modules['pytest'] = MagicMock()\nimport tests.seams.test_maxwell"
    ended = mpirun(2, "run", str(file), "--output", str(tmp_path / "run"), "-q", before=before)
    assert ended.returncode == 0, ended.stderr
    one, other = open_run(tmp_path / "run"), open_run(whole)
    for name, values in other.series.items():
        np.testing.assert_allclose(one.series[name], values, rtol=1e-9, err_msg=name)
    stresses = [run.fields(6 * STEP)["principal_stresses_Pa"] for run in (one, other)]
    np.testing.assert_allclose(stresses[0], stresses[1], rtol=1e-6)
