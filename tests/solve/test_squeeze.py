"""A short vein squeezed for a few steps: what must hold at each of them, whatever the mesh."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
import pytest

from ngfsi.case import Case
from ngfsi.curves import PressureRamp
from ngfsi.measure import row
from ngfsi.measure.probe import Probe
from ngfsi.solve.system import System
from ngfsi.solve.timeloop import TimeLoop
from tests.vein import case_of, steady

FLOW = 2.913e-6
SQUEEZE = {
    "loads.skin_pressure": PressureRamp(final=1500.0, duration=0.04),
    "time.step": 0.02,
    "time.end": 0.06,
}


def rows_of(case: Case) -> tuple[list[dict[str, float]], System]:
    """Return the measured rows of a run, from t = 0 on, and the system in its last state."""
    system, newton = steady(case)
    probe = Probe(system)
    rows = []
    loop = TimeLoop(case, system, newton, lambda: "", lambda _: None)
    probe.refresh()
    rows.append(row(probe))
    for _ in loop.run():
        probe.refresh()
        rows.append(row(probe))
    return rows, system


def column(rows: list[dict[str, float]], name: str) -> Any:
    return np.array([entry[name] for entry in rows])


@pytest.fixture(scope="module")
def squeezed() -> tuple[list[dict[str, float]], System]:
    return rows_of(case_of(**SQUEEZE))


def test_the_vein_gives_way(squeezed: tuple[list[dict[str, float]], System]) -> None:
    volume = column(squeezed[0], "lumen_volume_m3")
    assert volume[2] < 0.98 * volume[0]


def test_inflow_through_the_moving_inlet_is_exact(squeezed: tuple[list[dict[str, float]], System]) -> None:
    assert column(squeezed[0], "flow_in_m3_s") == pytest.approx(FLOW, rel=1e-10)


def test_blood_is_neither_lost_nor_made(squeezed: tuple[list[dict[str, float]], System]) -> None:
    rows = squeezed[0]
    lost = -column(rows, "lumen_volume_rate_m3_s")
    assert np.max(lost) > 0.2 * FLOW
    # prisms of order 2: the continuity equation is integrated to about 1e-6 of the flow
    assert column(rows, "flow_out_m3_s") == pytest.approx(FLOW + lost, rel=1e-5)


def test_rate_of_the_volume_is_that_of_the_scheme(squeezed: tuple[list[dict[str, float]], System]) -> None:
    """The first step is backward Euler and the volume is nonlinear in the motion: equal to first order."""
    rows = squeezed[0]
    volume, rate = column(rows, "lumen_volume_m3"), column(rows, "lumen_volume_rate_m3_s")
    assert (volume[1] - volume[0]) / 0.02 == pytest.approx(rate[1], rel=2e-2)


def test_sections_hold_the_volume(squeezed: tuple[list[dict[str, float]], System]) -> None:
    """Mean area by Simpson's rule over that of the circle, against volume over volume: both lose the same share."""
    rows, system = squeezed
    weights = np.array([1, 4, 2, 4, 2, 4, 2, 4, 2, 4, 1]) / 30
    circle = np.pi * system.domain.geometry.lumen_radius**2
    for entry in rows:
        mean = sum(w * entry[f"area_z{i:02d}_m2"] for i, w in enumerate(weights))
        left = entry["lumen_volume_m3"] / system.domain.volume("fluid")
        assert mean / circle == pytest.approx(left, rel=2e-4)


@pytest.mark.parametrize(("ends", "held"), [("roller", (2,)), ("clamped", (0, 1, 2)), ("free", ())])
def test_end_conditions(ends: Any, held: tuple[int, ...]) -> None:
    """End faces of solids and mesh stay in their plane (roller), stay at all (clamped), or move along z (free)."""
    case = case_of(**SQUEEZE, **{"conditions.ends": ends}).replace(**{"time.end": 0.02})
    _, system = rows_of(case)
    motion = system.fields(system.state.components).motion
    domain = system.domain
    for face in ("tissue_top", "tissue_bottom", "wall_top", "wall_bottom", "inlet", "outlet"):
        measure = domain.ds(face)
        size = [float(ng.Integrate(motion[i] * motion[i] * measure, domain.mesh)) ** 0.5 for i in range(3)]
        largest = 1e-6 * domain.area(face) ** 0.5
        for i in range(3):
            assert (size[i] < 1e-12 * largest) == (i in held), (face, i, size)


@pytest.mark.parametrize("initial", ["preload", "prestress"])
def test_held_loads_leave_the_steady_state_alone(initial: Any) -> None:
    rows, system = rows_of(case_of(**{"conditions.initial_state": initial}))
    for name in ("lumen_volume_m3", "sawss_Pa"):
        values = column(rows, name)
        assert values == pytest.approx(values[0], rel=1e-6)
    if initial == "prestress":
        displacement = system.values[system.unknowns.blocks["d"]]
        assert np.max(np.abs(displacement)) < 1e-8 * system.domain.geometry.lumen_radius
        assert rows[0]["lumen_volume_m3"] == pytest.approx(system.domain.volume("fluid"), rel=1e-12)


@pytest.mark.parametrize(
    ("change", "accuracy"),
    [({"discretisation.extension_stiffness": 1000.0}, 1e-8), ({"solver.tolerance": 1e-6}, 1e-6)],
)
def test_what_must_not_matter(
    squeezed: tuple[list[dict[str, float]], System], change: dict[str, Any], accuracy: float
) -> None:
    """Stiffness of the mesh motion; and a tolerance of 1e-6, tightened by 100 to the default."""
    other, _ = rows_of(case_of(**SQUEEZE, **change))
    for name in ("lumen_volume_m3", "sawss_Pa"):
        assert column(other, name) == pytest.approx(column(squeezed[0], name), rel=accuracy)
