"""The one-dimensional vein against exact solutions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.special import jv

from ngfsi.analysis.tube_law import LAWS, TubeLaw
from ngfsi.analysis.vein_1d import RATES, CollapsibleVein
from ngfsi.errors import SolverError
from ngfsi.materials import load_set
from ngfsi.materials.fluid.law import FluidLaw

LENGTH, AREA, DENSITY, VISCOSITY, FLOW = 0.12, 9e-5, 1060.0, 3.5e-3, 2.9e-6
CELLS = 60


def vein(law: str = "elastic ring", *, area: float = AREA, stiffness: float = 2e4, cells: int = CELLS,
         viscosity: float = VISCOSITY, flow: float = FLOW, outlet=lambda _: 0.0, external=lambda _: 0.0,
         ) -> CollapsibleVein:  # type: ignore[no-untyped-def]  # fmt: skip
    parameters = TubeLaw(law, np.full(cells, area), np.full(cells, stiffness))
    return CollapsibleVein(parameters, LENGTH, DENSITY, lambda _: viscosity, lambda _: flow, outlet, external)


def test_poiseuille() -> None:
    """In a stiff vein: the pressure of developed flow, its shear, and nothing that changes."""
    stiff = vein(stiffness=1e6)
    found = stiff.solve(np.linspace(0, 0.01, 3))
    drop = 8 * np.pi * VISCOSITY * FLOW / AREA**2 * (LENGTH - found.places)
    assert stiff.law.pressure(stiff.steady(0.0)[:CELLS]) == pytest.approx(drop, rel=1e-4)
    radius = np.sqrt(AREA / np.pi)
    assert found.sawss == pytest.approx(np.full(3, 4 * VISCOSITY * FLOW / (np.pi * radius**3)), rel=1e-5)
    assert found.flow == pytest.approx(np.full((3, CELLS + 1), FLOW), rel=1e-4)


def test_blood_that_thins() -> None:
    """In a stiff vein: drop of pressure and shear of developed flow, by Weissenberg and Rabinowitsch."""
    law, radius = load_set("blood_carreau"), np.sqrt(AREA / np.pi)
    assert isinstance(law, FluidLaw)
    places = TubeLaw("elastic ring", np.full(CELLS, AREA), np.full(CELLS, 1e6))
    none = lambda _: 0.0  # noqa: E731
    thin = CollapsibleVein(places, LENGTH, DENSITY, law.developed_viscosity, lambda _: FLOW, none, none)
    found, rate = thin.solve(np.linspace(0, 5e-4, 2)), 4 * FLOW / (np.pi * radius**3)
    wall = float(law.developed_viscosity(rate)) * rate
    assert wall > 1.5 * VISCOSITY * rate
    assert found.sawss == pytest.approx(np.full(2, wall), rel=1e-4)
    drop = thin.law.pressure(thin.steady(0.0)[:CELLS])
    assert drop == pytest.approx(2 * wall / radius * (LENGTH - found.places), rel=1e-3)


def bernoulli(cells: int) -> float:
    """Largest error of p + rho u^2 / 2, over the change of p, in a tapering vein without friction."""
    places = (np.arange(cells) + 0.5) / cells
    law = TubeLaw("elastic ring", AREA * (1 - 0.5 * places), np.full(cells, 2e4))
    found = CollapsibleVein(law, LENGTH, DENSITY, lambda _: 0.0, lambda _: 1e-4, lambda _: 0.0, lambda _: 0.0)
    area = found.steady(0.0)[:cells]
    pressure = law.pressure(area)
    total = pressure + DENSITY / 2 * (1e-4 / area) ** 2
    return float(np.ptp(total) / np.ptp(pressure))


def test_bernoulli() -> None:
    """Exact without friction; the ends cost a part of the second order."""
    coarse, fine = bernoulli(40), bernoulli(80)
    assert fine < 2e-3
    assert np.log2(coarse / fine) > 1.5


@pytest.mark.parametrize("name", LAWS)
def test_waves(name: str) -> None:
    """A small pulse at the outlet runs up the vein with c = sqrt(A/rho dT/dA), and back from its closed end."""
    slope = {"linear": 1.0, "elastic ring": 0.5, "collapsible": 11.5}[name]  # of T / K by the ratio of areas, at rest
    speed = np.sqrt(1e4 * slope / DENSITY)
    width, height = LENGTH / (6 * speed), 5.0
    when = 4 * width

    def pulse(time: np.ndarray | float) -> np.ndarray:
        return np.asarray(height * np.exp(-(((time - when) / width) ** 2)))

    found = vein(name, stiffness=1e4, flow=0.0, viscosity=0.0, cells=120, outlet=lambda time: float(pulse(time)))
    times = np.linspace(0, when + 1.5 * LENGTH / speed, 40)
    solution = found.solve(times)
    late, x = times[:, None], solution.places
    exact = pulse(late - (LENGTH - x) / speed) + pulse(late - (LENGTH + x) / speed)
    assert np.max(exact[:, 0]) > 1.8 * height
    assert np.abs(found.law.pressure(solution.area) - exact).max() < 0.02 * height


def test_balance_of_mass() -> None:
    """What enters less what leaves is what the vein gains, while it is squeezed."""
    squeezed = vein(external=lambda time: 3000.0 * np.sin(np.pi * time / 0.4) ** 2)
    times = np.linspace(0, 0.4, 801)
    found = squeezed.solve(times)
    volume = found.mean_area * LENGTH
    assert volume.min() < 0.8 * volume[0]
    for end in (200, 400, 800):
        net = simpson(found.flow[: end + 1, 0] - found.flow[: end + 1, -1], times[: end + 1])
        assert volume[end] - volume[0] == pytest.approx(net, rel=1e-5, abs=1e-5 * (volume[0] - volume.min()))


def test_choking() -> None:
    """No steady flow passes through a narrow vein with the speed of its waves."""
    with pytest.raises(SolverError, match=r"no steady flow|chokes"):
        vein("collapsible", stiffness=10.0, flow=5e-5).solve(np.array([0.0, 1.0]))


@pytest.mark.parametrize("womersley", [0.3, 3.0, 10.0, 25.0])
def test_shear_of_oscillating_flow(womersley: float) -> None:
    """Over the mean velocity, R/mu times the shear is L J1(L) / J2(L), L^2 = -i womersley^2 (Womersley 1955)."""
    root = np.sqrt(-1j) * womersley
    exact = root * jv(1, root) / jv(2, root)
    radius = np.sqrt(AREA / np.pi)
    rate = 1j * womersley**2 * VISCOSITY / DENSITY / radius**2
    modes = rate / (rate + RATES * VISCOSITY / DENSITY / radius**2)
    states = np.vstack([np.full(CELLS, AREA), np.ones(CELLS), np.tile(modes, (1, CELLS))]).astype(complex)
    tube = vein()
    # these are the modes of a velocity that oscillates: they obey the equations
    rates = tube.rates(0.0, states.ravel()).reshape(states.shape)
    assert rates[2:] - rates[1] == pytest.approx(rate * (states[2:] - states[1]), rel=1e-9)
    found = tube._shear(states)[0] * radius / VISCOSITY
    assert abs(found / exact - 1) < 0.02
    if womersley < 1:  # the momentum of the parabolic profile: a third more
        assert (found - 4).imag == pytest.approx(womersley**2 / 6, rel=1e-3)
