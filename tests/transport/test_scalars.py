"""What the blood carries, against closed forms: pipes with developed flow, flow that turns, states alike everywhere."""

from __future__ import annotations

from functools import cache
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from numpy.typing import NDArray

from ngfsi.case import Case
from ngfsi.errors import CaseError
from ngfsi.materials import load_set
from ngfsi.measure.scalars import Scalars
from ngfsi.physics.fields import VELOCITY
from ngfsi.system.system import System
from ngfsi.transport.models import Age, Exposure, NearWall, ScalarModel, Washout
from ngfsi.transport.returning import Returning
from tests.vein import BLOOD, COARSE, TUBE, case_of, system_of

Array = NDArray[np.float64]

PIPE = TUBE.replace(mesh=COARSE.replace(axial_layers=6, lumen_radii=(0.8, 0.5)))
L, R = PIPE.length, PIPE.lumen_radius
MEAN = 5e-3
TRANSIT = L / MEAN
"""Mean time of transit (s)."""


def carrying(*scalars: ScalarModel, **changes: Any) -> Scalars:
    return Scalars(system_of(case_of(PIPE, scalars=scalars, **changes)))


def let_flow(system: System, mean: float) -> None:
    """Developed flow with a mean velocity (m/s)."""
    radius = ng.x**2 + ng.y**2
    velocity = system.named(system.state)[VELOCITY]
    velocity.Set(2 * mean * (1 - radius / R**2) * ng.CF((0, 0, 1)), definedon=system.domain.materials("fluid"))


@cache
def washed() -> tuple[Array, dict[str, Array]]:
    """Times over the transit, and columns, of a pipe through which blood flows from t = 0 on."""
    scalars = carrying(Age(), Washout(washed_out=0.8))
    let_flow(scalars.system, MEAN)
    times, rows = np.linspace(0, 1.5, 31), []
    for time in times:
        scalars.advance(time * TRANSIT)
        rows.append({column: of() for column, of in scalars.columns().items()})
    return times, {column: np.array([row[column] for row in rows]) for column in rows[0]}


def test_washout_of_developed_flow() -> None:
    """The volume that is left is the integral of 1 - F, F = 1 - (t_m / 2t)^2 from t_m / 2 on."""
    times, found = washed()
    late = np.maximum(times, 0.5)
    left = np.where(times < 0.5, 1 - times, 1 / (4 * late))
    assert found["washout_left_1"] == pytest.approx(left, abs=0.008)
    assert found["washout_left_1"] == pytest.approx(found["washout_mean_1"], rel=1e-12)
    leaving = np.where(times < 0.5, 1, 1 / (2 * late) ** 2)
    error = found["washout_outlet_1"] - leaving
    # a front passes at t_m / 2
    assert np.abs(error).max() < 0.1
    assert np.abs(error).mean() < 0.012
    assert found["washout_max_1"].max() <= 1 + 1e-12
    assert np.isnan(found["washout_time_s"][times < 1.2]).all()
    assert found["washout_time_s"][-1] == pytest.approx(TRANSIT / (4 * 0.2), rel=0.02)


def test_age_of_developed_flow() -> None:
    """At the outlet L / u(r), but no more than the time: its mean over the flow is t_m (1 - t_m / 4t)."""
    times, found = washed()
    late = np.maximum(times, 0.5)
    assert found["age_outlet_s"] / TRANSIT == pytest.approx(np.where(times < 0.5, times, 1 - 1 / (4 * late)), abs=0.004)
    assert found["age_max_s"] / TRANSIT == pytest.approx(times, abs=1e-12)
    # z / u over the volume, as far as it is less than the time
    assert found["age_mean_s"][-1] / TRANSIT == pytest.approx(mean_age(1.5), rel=0.005)


def mean_age(time: float) -> float:
    """Return the mean age in a pipe with developed flow, both over the time of transit."""
    nodes, weights = np.polynomial.legendre.leggauss(400)
    s, z = (nodes + 1) / 2, (nodes + 1) / 2
    age = np.minimum(z[:, None] / (2 * (1 - s)), time)
    return float(weights @ age @ weights / 4)


def test_age_across_the_outlet() -> None:
    """At points of the outlet, away from the wall."""
    scalars = carrying(Age())
    let_flow(scalars.system, MEAN)
    for time in np.linspace(0, 1.2, 25):
        scalars.advance(time * TRANSIT)
    cells = scalars.cells
    places = np.concatenate([at.reshape(-1, 3) for at in cells.face_places])
    there = cells.openings["outlet"]
    radii = np.linalg.norm(places[there, :2], axis=1)
    ages = scalars._traces(scalars.carried["age"])[there]
    exact = L / (2 * MEAN * (1 - (radii / R) ** 2))
    near = radii < 0.7 * R
    assert np.count_nonzero(near) > 50
    assert ages[near] == pytest.approx(exact[near], rel=0.05)


def test_blood_that_comes_back_is_as_old_as_the_time() -> None:
    """Half of the blood leaves through the inlet, and then half through the outlet: it was here from the start."""
    scalars = carrying(Age())
    for time, mean in ((0.0, -MEAN), (0.25, -MEAN), (0.5, -MEAN), (0.5 + 1e-9, MEAN), (0.75, MEAN), (1.0, MEAN)):
        let_flow(scalars.system, mean)
        scalars.advance(time * TRANSIT)
    column = scalars.columns()["age_mean_s"]
    assert column() == pytest.approx(TRANSIT, rel=3e-3)
    scalars.advance(1.25 * TRANSIT)
    # a quarter is new, of a mean age of an eighth
    assert column() == pytest.approx(TRANSIT * (0.75 * 1.25 + 0.25 / 8), rel=0.01)


def test_what_returns_is_what_left_last() -> None:
    beyond = Returning(fresh=True, most=3.0, outside=lambda seconds: 10 * seconds)
    assert beyond.entering(1.0, 0.0) == 0.0
    beyond.turn(0.0, 2.0, 2 * 5.0, 0.0)
    beyond.turn(0.0, 1.0, 1 * 7.0, 1.0)
    assert beyond.entering(1.0, 1.0) == 7.0
    assert beyond.entering(2.0, 2.0) == pytest.approx((17.0 + 25.0) / 2)
    # more than has left: the rest is fresh
    assert beyond.entering(4.0, 1.0) == pytest.approx((7.0 + 2 * 15.0) / 4)
    beyond.turn(1.5, 0.0, 0.0, 2.0)
    assert beyond.array() == pytest.approx(np.array([[1.5, 7.5, 0.0]]))
    beyond.turn(0.0, 2.0, 0.0, 3.0)
    assert beyond.array() == pytest.approx(np.array([[1.0, 5.0, 0.0], [2.0, 0.0, 3.0]]))
    unknown = Returning(fresh=False, most=3.0, outside=lambda _: 0.0)
    assert unknown.entering(1.0, 0.0) is None
    unknown.turn(0.0, 1.0, 4.0, 0.0)
    assert unknown.entering(2.0, 0.0) == 4.0


RATE = np.array([[1.1, 0.7, 3.0], [-0.4, -2.3, 1.5], [0.2, -1.0, 1.2]])
STRETCH = np.array([[1.12, 0.2, 0.1], [-0.05, 0.8, -0.15], [0.1, 0.0, 1.3]])


def matrix(values: Array) -> Any:
    return ng.CF(tuple(values.ravel().tolist()), dims=(3, 3))


@pytest.mark.parametrize("fluid", [BLOOD, load_set("blood_carreau")])
def test_exposure_where_all_deforms_alike(fluid: Any) -> None:
    """x = F X, u = A x, and nothing flows through the mesh: the shear rate is that of A, and tau t^0.452 grows."""
    activation = Exposure(name="activation", constant=2.0, stress_power=1.3, time_power=0.6)
    scalars = carrying(Exposure(), activation, **{"materials.fluid": fluid})
    system = scalars.system
    place = ng.CF((ng.x, ng.y, ng.z))
    system.motion.Set(matrix(STRETCH) * place - place)
    system.new_weight.Set(2.0)
    velocity = matrix(RATE) * (matrix(STRETCH) * place)
    system.velocity_history.components[0].Set(velocity - 2 * (matrix(STRETCH) * place - place))
    twice = RATE + RATE.T
    rate = np.sqrt(np.sum(twice**2) / 2)
    stress = float(fluid.viscosity_at(rate)) * rate
    for time in (0.0, 0.5, 2.0):
        scalars.advance(time)
    for column in ("exposure_mean_1", "exposure_max_1"):
        assert scalars.columns()[column]() == pytest.approx(stress * 2.0**0.452, rel=1e-9)
    assert scalars.columns()["activation_mean_1"]() == pytest.approx(2 * stress**1.3 * 2.0**0.6, rel=1e-9)


def test_time_near_the_wall() -> None:
    """Of blood at rest: where it is nearer than the layer, which is a ring."""
    layer = 0.35 * R
    scalars = carrying(NearWall(layer=layer))
    for time in (0.0, 3.0):
        scalars.advance(time)
    assert scalars.columns()["near_wall_mean_s"]() == pytest.approx(3 * (1 - 0.65**2), rel=0.04)
    assert scalars.columns()["near_wall_max_s"]() == pytest.approx(3.0, rel=3e-3)


def test_activation_of_platelets_in_developed_flow() -> None:
    """tau t of a path through a pipe is 2 mu L r / (R^2 - r^2), whatever the velocity, here over 3.5 Pa s;
    and lysis, the 3.31e-8 (tau/Pa)^3.075 (t/s)^0.77 of Giersiepen."""
    lysis = Exposure(name="lysis", measure="lysis")
    scalars = carrying(Exposure(measure="activation"), lysis)
    let_flow(scalars.system, MEAN)
    for time in np.linspace(0, 3, 61):
        scalars.advance(time * TRANSIT)
    s, w = (np.polynomial.legendre.leggauss(200)[k] / 2 + (0.5, 0.0)[k] for k in (0, 1))
    s = s**0.5
    speed = 2 * MEAN * (1 - s**2)
    age = np.minimum(L / speed, 3 * TRANSIT)
    tau = 4 * BLOOD.viscosity * MEAN * s / R
    found = scalars.columns()
    assert found["exposure_outlet_1"]() == pytest.approx(w @ (speed * tau * age / 3.5) / MEAN, rel=0.02)
    crossed = 2 * BLOOD.viscosity * L * s / (1 - s**2) / R / 3.5
    assert (tau * age / 3.5)[:120] == pytest.approx(crossed[:120], rel=1e-12)
    exact = 3.31e-8 * tau**3.075 * age**0.77
    assert found["lysis_outlet_1"]() == pytest.approx(w @ (speed * exact) / MEAN, rel=0.02)
    assert Exposure(measure="lysis", constant=1.0).stress_power == 3.075


def test_exposure_at_the_outlet() -> None:
    """Of developed flow: tau (L/u)^0.452 along each path, tau = 2 mu u_max r / R^2; and the time near the wall, of
    paths that are near it all the way."""
    layer = 0.3 * R
    scalars = carrying(Exposure(), NearWall(layer=layer))
    let_flow(scalars.system, MEAN)
    for time in np.linspace(0, 3, 61):
        scalars.advance(time * TRANSIT)
    s, w = (np.polynomial.legendre.leggauss(200)[k] / 2 + (0.5, 0.0)[k] for k in (0, 1))
    s, w = s**0.5, w
    speed = 2 * MEAN * (1 - s**2)
    age = np.minimum(L / speed, 3 * TRANSIT)
    exposure = 4 * BLOOD.viscosity * MEAN * s / R * age**0.452
    found = scalars.columns()
    assert found["exposure_outlet_1"]() == pytest.approx(w @ (speed * exposure) / MEAN, rel=0.01)
    near = w @ (speed * age * (s > 0.7)) / MEAN
    assert found["near_wall_outlet_s"]() == pytest.approx(near, rel=0.08)


def test_a_box_is_marked_at_its_time() -> None:
    box = ((-1.0, -1.0, L / 3), (1.0, 1.0, 2 * L / 3))
    scalars = carrying(Washout(start=0.15 * TRANSIT, corners=box, washed_out=0.5))
    let_flow(scalars.system, MEAN)
    columns = scalars.columns()
    for time in (0.0, 0.1, 0.2):
        scalars.advance(time * TRANSIT)
        assert columns["washout_mean_1"]() == pytest.approx(1 / 3, rel=1e-9)
    for time in np.linspace(0.3, 1.2, 19):
        scalars.advance(time * TRANSIT)
    assert columns["washout_time_s"]() == pytest.approx(half_left() * TRANSIT, rel=0.05)


def half_left() -> float:
    """Return the time, over that of transit, at which half of what was in the middle third of the pipe has left."""
    s = (np.arange(4000) + 0.5) / 4000
    speed = 2 * (1 - s)
    times = np.linspace(0.1, 1.0, 2000)
    left = [np.clip(1 - speed * t, 1 / 3, 2 / 3).mean() - 1 / 3 for t in times]
    return float(np.interp(0.5, 1 - 3 * np.array(left), times))


def test_washout_of_a_vein_that_is_squeezed() -> None:
    """Nothing enters: what is left is as much as the volume, which passes a half at two thirds of the second step."""
    scalars = carrying(Washout(washed_out=0.5))
    for time, volume in ((0.0, 1.0), (1.0, 0.6), (2.0, 0.45), (3.0, 0.4)):
        narrower = volume**0.5 - 1
        scalars.system.motion.Set(ng.CF((narrower * ng.x, narrower * ng.y, 0)))
        scalars.advance(time)
        assert scalars.columns()["washout_left_1"]() == pytest.approx(volume, rel=1e-10)
    assert scalars.columns()["washout_time_s"]() == pytest.approx(1 + 2 / 3, rel=1e-9)


def test_what_cannot_be_carried_is_refused() -> None:
    base = case_of(PIPE).to_toml_dict()
    with pytest.raises(CaseError, match=r"'scalars' .*several scalars 'age': give each a name"):
        Case.from_dict({**base, "scalars": [{"kind": "age"}, {"kind": "age"}]})
    with pytest.raises(CaseError, match=r"kind' has an unknown value.*known are age, exposure, near_wall, washout"):
        Case.from_dict({**base, "scalars": [{"kind": "aeg"}]})
    Case.from_dict({**base, "scalars": [{"kind": "age"}, {"kind": "age", "name": "second"}]})
