"""Viscosity of solids against relaxation, storage and loss moduli, an integral at finite strain, and its energy."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from scipy.integrate import quad

from ngfsi.arrays import Array
from ngfsi.case import Conditions
from ngfsi.errors import MaterialError
from ngfsi.materials.solid.directions import ConstantDirection
from ngfsi.materials.solid.holzapfel_gasser_ogden import HolzapfelGasserOgden
from ngfsi.materials.solid.mooney_rivlin import MooneyRivlin
from ngfsi.materials.solid.viscosity import SolidViscosity
from ngfsi.measure.deformation import Deformation
from ngfsi.measure.energy import Energy
from ngfsi.mesh.domain import Domain
from ngfsi.physics.fields import STRETCH
from ngfsi.run import run
from ngfsi.system.forms import residual_form
from ngfsi.system.schemes import Weights
from ngfsi.system.system import System
from tests.runs import assert_resumed
from tests.seams.block import SIDE, case_of, domain
from tests.seams.test_maxwell import Stretched, Stretching
from tests.solve.test_statics import OUTER
from tests.solve.test_statics import case_of as ring_case
from tests.vein import domain_of

I = np.eye(3)  # noqa: E741
G, TAU, ETA = np.array([20e3, 6e3]), np.array([0.4, 0.05]), 300.0
PRONY = SolidViscosity(moduli=tuple(G), times=tuple(TAU))
LAW = MooneyRivlin(c10=6e3, c01=-2e3, c11=4e3, K=40e3, density=1000.0, viscosity=PRONY)
ALL = LAW.replace(viscosity=PRONY.replace(kelvin_voigt=ETA))

Path_ = Callable[[float], Array]


@cache
def cube() -> Domain:
    return domain()


def system_of(law: Any, **changes: Any) -> System:
    return System(case_of(law, **changes), cube(), more=[Stretching("held")])


def unit(i: int, j: int) -> Array:
    return np.asarray(np.outer(I[i], I[j]))


@cache
def linear_motions() -> Array:
    """Return the motions (9, unknowns) of the gradients that have one entry of 1."""
    space = ng.VectorH1(cube().mesh, order=2)
    field, found = ng.GridFunction(space), []
    for i in range(3):
        for j in range(3):
            field.Set(ng.CF(tuple((ng.x, ng.y, ng.z)[j] if k == i else 0.0 for k in range(3))))
            found.append(np.array(field.vec.FV().NumPy()))
    return np.array(found)


def deform(field: ng.GridFunction, gradient: Array) -> None:
    """Write the motion of a homogeneous gradient."""
    field.vec.FV().NumPy()[:] = np.ravel(gradient) @ linear_motions()


def followed(law: Any, path: Path_, times: Array) -> Iterator[System]:
    """Yield a system after each step along homogeneous deformations, with their exact rates, accepted step by step."""
    system = system_of(law)
    motion, rate = system.motion, system.velocity_history.components[0]
    deform(motion, path(times[0]) - I)
    for before, now in pairwise(times):
        system.accept()
        system.set_step(now - before)
        deform(motion, path(now) - I)
        deform(rate, (path(now + 1e-5) - path(now - 1e-5)) / 2e-5)
        yield system


@cache
def stress_of(system: System) -> Any:
    return system.cauchy_stress("solid"), system.domain.mesh(3e-3, 4e-3, 6e-3)


def cauchy(system: System) -> Array:
    field, at = stress_of(system)
    return np.array(field(at)).reshape(3, 3)


def over(law: Any, path: Path_, times: Array) -> Array:
    """Return the Cauchy overstress after each step: what the law has beside its own stress."""
    elastic = system_of(law.replace(viscosity=None))
    found = []
    for now, system in zip(times[1:], followed(law, path, times), strict=True):
        deform(elastic.motion, path(now) - I)
        found.append(cauchy(system) - cauchy(elastic))
    return np.array(found)


def pushed(F: Array, Q: Array) -> Array:
    """Return J^-1 dev(Fb Q Fb^T)."""
    J = np.linalg.det(F)
    whole = J ** (-2 / 3) * F @ Q @ F.T / J
    return np.asarray(whole - np.trace(whole) / 3 * I)


def isochoric(F: Array) -> Array:
    return np.asarray(np.linalg.det(F) ** (-2 / 3) * F.T @ F)


def test_relaxation_after_a_step() -> None:
    """Deformed evenly in Cb within a step h and held, sheared, turned and compressed at once: by hand to rounding."""
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    F, h = turn @ np.array([[1.2, 0.4, 0.0], [0.0, 0.8, 0.1], [0.0, 0.0, 0.9]]), 0.02
    times = np.array([0.0, h, 0.1, 0.11, 0.6])
    found = over(LAW, lambda t: F if t >= h else I, times)
    for t, stress in zip(times[1:], found, strict=True):
        Q = np.sum(G * TAU / h * (1 - np.exp(-h / TAU)) * np.exp(-(t - h) / TAU)) * (isochoric(F) - I)
        assert stress == pytest.approx(pushed(F, Q), rel=1e-9, abs=1e-9 * G[0])


def test_storage_and_loss_moduli() -> None:
    """Small harmonic shear: those of the Prony series and the dashpot, within the error of the recurrence."""
    w, steps, small = 5.0, 40, 1e-4
    times = np.arange(3 * steps + 1) * 2 * np.pi / w / steps
    found = over(ALL, lambda t: I + small * np.sin(w * t) * unit(0, 1), times)[-steps:, 0, 1] / small
    phase = w * times[-steps:]
    storage, loss = (2 * np.mean(found * wave) for wave in (np.sin(phase), np.cos(phase)))
    x = w * TAU
    assert storage == pytest.approx(np.sum(G * x**2 / (1 + x**2)), rel=3e-3)
    assert loss == pytest.approx(np.sum(G * x / (1 + x**2)) + ETA * w, rel=3e-3)


def stretched(t: float) -> Array:
    """Return a stretch that comes, goes and changes the volume, from rest."""
    stretch = 1 + 0.4 * np.sin(3 * t) ** 2
    return np.diag([stretch, stretch**-0.3, stretch**-0.5])


END = 0.9


def exact_elements() -> list[Array]:
    """Return Q at the end by the integral of e^(-(t - s)/tau) dCb/ds, which is the solution of each scalar equation."""
    last, found = isochoric(stretched(END)), []
    for modulus, tau in zip(G, TAU, strict=True):

        def entry(i: int, tau: float = float(tau)) -> float:
            integrand = lambda s: np.exp((s - END) / tau) / tau * isochoric(stretched(s))[i, i]  # noqa: E731
            return float(quad(integrand, 0, END, epsrel=1e-11, epsabs=1e-12, limit=200)[0])

        by_parts = [last[i, i] - np.exp(-END / tau) - entry(i) for i in range(3)]
        found.append(modulus * np.diag(by_parts))
    return found


def test_finite_strain() -> None:
    """The overstress of a large stretch converges with the second order to its integral."""
    exact = pushed(stretched(END), sum(exact_elements()))
    errors = [
        np.abs(over(LAW, stretched, np.linspace(0, END, n + 1))[-1] - exact).max() / np.abs(exact).max()
        for n in (30, 60)
    ]
    assert errors[1] < 4e-3
    assert 3.7 < errors[0] / errors[1] < 4.3


def test_uneven_steps_are_as_good() -> None:
    exact = pushed(stretched(END), sum(exact_elements()))
    sizes = np.random.default_rng(3).uniform(0.3, 1.7, 60)
    times = END * np.concatenate([[0.0], np.cumsum(sizes) / np.sum(sizes)])
    assert np.abs(over(LAW, stretched, times)[-1] - exact).max() < 8e-3 * np.abs(exact).max()


def test_energy() -> None:
    """What the stresses do is held or becomes heat, Q : Q/(2 G tau) and the dashpot's, which is never negative."""
    times = np.linspace(0, END, 41)
    heat, powers = [0.0], [0.0]
    elastic = Energy(system_of(ALL.replace(viscosity=None)))
    energy: Energy | None = None
    for now, system in zip(times[1:], followed(ALL, stretched, times), strict=True):
        energy = energy or Energy(system)
        elastic.system.motion.vec.data = system.motion.vec
        elastic.system.velocity_history.vec.data = system.velocity_history.vec
        heat.append(energy.dissipation())
        F, change = stretched(now), (stretched(now + 1e-5) - stretched(now - 1e-5)) / 2e-5
        over = cauchy(system) - cauchy(elastic.system)
        powers.append(SIDE**3 * np.linalg.det(F) * float(np.sum(over * (change @ np.linalg.inv(F)))))
    assert energy is not None
    assert min(heat) >= 0 > min(powers)
    assert energy.rate() - elastic.rate() == pytest.approx(powers[-1] - heat[-1], abs=1e-8 * max(powers))
    held, warm = 0.0, 0.0
    for Q, modulus, tau in zip(exact_elements(), G, TAU, strict=True):
        held += SIDE**3 * np.sum(Q * Q) / (4 * modulus)
        warm += SIDE**3 * np.sum(Q * Q) / (2 * modulus * tau)
    rate = (isochoric(stretched(END + 1e-5)) - isochoric(stretched(END - 1e-5))) / 2e-5
    warm += SIDE**3 * ETA / 2 * np.sum(rate**2)
    found = energy.stored() - elastic.stored()
    assert (found, heat[-1]) == pytest.approx((held, warm), rel=1e-2)
    work = np.trapezoid(powers, times)
    assert found + np.trapezoid(heat, times) == pytest.approx(work, rel=5e-3)


def test_at_rest_the_law_alone_is_left() -> None:
    """At infinite time, which initial states and the static scheme are, and what is asked for stability."""
    *_, system = followed(ALL, stretched, np.linspace(0, END, 4))
    system.set_rates(Weights(0.0, 0.0, 0.0), (np.zeros(1),) * 2, (np.zeros(1),) * 2, np.inf)
    elastic = system_of(ALL.replace(viscosity=None))
    deform(elastic.motion, stretched(END) - I)
    assert cauchy(system) == pytest.approx(cauchy(elastic), rel=1e-9, abs=1e-6)


def test_stiffness_for_stability_is_that_at_rest() -> None:
    *_, system = followed(ALL, stretched, np.linspace(0, END, 4))
    elastic = system_of(ALL.replace(viscosity=None))
    deform(elastic.motion, stretched(END) - I)
    forces = []
    for one in (system, elastic):
        space = one.unknowns.space.components[0]
        form, found = residual_form(space, one.static_integrals(*space.TnT())), one.motion.vec.CreateVector()
        form.Apply(one.motion.vec, found)
        forces.append(np.array(found.FV().NumPy()))
    np.testing.assert_allclose(*forces, rtol=1e-9, atol=1e-9 * np.abs(forces[1]).max())


def test_plane_stress() -> None:
    """The stretch across the plane is strain as any other, now and before."""
    F, h, later = np.array([[1.2, 0.1, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 1.1]]), 0.02, 0.1
    found = []
    for viscosity in (PRONY, None):
        case = ring_case("tibia", plane_stress=("tissue",))
        case = case.replace(**{"materials.tissue": LAW.replace(viscosity=viscosity)})
        system = System(case, domain_of(case.geometry))
        system.accept()
        system.motion.Set(ng.CF((0.2 * ng.x + 0.1 * ng.y, -0.1 * ng.y)))
        system.named(system.state)[STRETCH].Set(0.1)
        system.set_step(h)
        system.accept()
        system.set_step(later)
        at = system.domain.mesh(0.9 * OUTER, 0)
        found.append(np.array(system.cauchy_stress("tissue")(at)).reshape(3, 3))
    left = np.sum(G * TAU / h * (1 - np.exp(-h / TAU)) * np.exp(-later / TAU))
    exact = pushed(F, left * (isochoric(F) - I))
    assert found[0] - found[1] == pytest.approx(exact, rel=1e-8, abs=1e-8 * G[0])


def test_fibres_with_viscosity_have_their_ellipticity_checked() -> None:
    law = HolzapfelGasserOgden(fibres=(ConstantDirection(vector=(1.0, 0.0, 0.0)),), K=80e3, c=9e3, k1=7e3, k2=2.3,
                               kappa=0.1, density=1060.0, viscosity=PRONY)  # fmt: skip
    system = system_of(law)
    deform(system.motion, np.diag([0.2, 0.0, 0.0]))
    assert not Deformation(system).approaching()


def test_refusals() -> None:
    with pytest.raises(MaterialError, match="moduli has 2 values and times 1: each element needs both"):
        SolidViscosity(moduli=(1.0, 2.0), times=(1.0,))
    with pytest.raises(MaterialError, match="needs moduli and times, or kelvin_voigt"):
        SolidViscosity()
    with pytest.raises(MaterialError, match="has a viscosity, which small strain has not"):
        system_of(LAW, conditions=Conditions(ends="roller", strain="small"))


FREE = {"time.scheme": "esdirk3", "time.error_tolerance": 1e-3, "time.smallest_step": 1e-3}
HALVED = {"time.error_tolerance": 3e-3, "time.smallest_step": 1e-3}


@pytest.mark.parametrize("scheme", [FREE, HALVED], ids=["esdirk3", "bdf2"])
def test_resumed_it_is_the_same_run(scheme: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit, with steps of chosen sizes."""
    changes = {"loads.further": (Stretched(),), "time.step": 0.1, "time.end": 0.4, "output.checkpoint_every": 1}
    case = case_of(ALL, **{"solver.tolerance": 1e-8, **changes, **scheme})
    whole = run(case, tmp_path / "whole", quiet=True).path
    assert_resumed(case, tmp_path / "run", whole, monkeypatch)
