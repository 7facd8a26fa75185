"""A branched vessel: sections along each centreline, the flow through them, and a run with its columns and report."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from numpy.typing import NDArray

from ngfsi.analysis.tube import tube_laws
from ngfsi.case import Case, Discretisation, Loads, Materials, TimeStepping
from ngfsi.conditions import FlowOpening, PressureOpening
from ngfsi.config.functions import FlowConstant, PressureConstant
from ngfsi.errors import OutputError
from ngfsi.measure.probe import Probe
from ngfsi.registry import register
from ngfsi.report import charts
from ngfsi.report.html import report
from ngfsi.report.shapes import unroll
from ngfsi.run import run
from ngfsi.store.stored import StoredRun
from ngfsi.system.system import System
from ngfsi.units import Shown
from tests.lumens import Tubes
from tests.runs import row
from tests.vein import BLOOD, domain_of, probe_of

Array = NDArray[np.float64]

RADIUS, FLOW = 4e-3, 1e-6
AREA = np.pi * RADIUS**2
SMALL = 0.6
"""Radius of the side branch over that of the trunk."""
REST = PressureConstant(value=0.0)


@register("ngfsi.geometries", "test_tee")
class Tee(Tubes):
    """A straight tube along z with a branch along x, of elements with curved edges."""

    curving_order = 2
    radius: float = RADIUS
    largest: float = 6e-3
    inlet: Any = (0.0, 0.0, -16e-3)
    fork: Any = (0.0, 0.0, 0.0)
    outlets: Any = (("outlet", (0.0, 0.0, 18e-3), RADIUS), ("outlet_2", (16e-3, 0.0, 0.0), SMALL * RADIUS))

    def inflow(self) -> None:
        """Let the developed profile be computed."""


def case_of(geometry: Tubes, **openings: Any) -> Case:
    return Case(
        name="tee",
        geometry=geometry,
        materials=Materials(fluid=BLOOD),
        loads=Loads(inlet_flow=FlowConstant(value=FLOW), outlet_pressure=REST, openings=openings),
        discretisation=Discretisation(order=2),
        time=TimeStepping(scheme="static", step=1.0, end=1.0),
    )


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> StoredRun:
    """The run of steady flow in the tee."""
    return run(case_of(Tee(), outlet_2=PressureOpening(pressure=REST)), tmp_path_factory.mktemp("tee") / "run",
               quiet=True)  # fmt: skip


def last(stored: StoredRun, name: str, unit: str) -> Array:
    return np.asarray(stored.along(name, unit)[-1])


def test_areas_along_each_branch(stored: StoredRun) -> None:
    """Circles of the trunk and of both branches; none where a plane leaves the trunk through the branch."""
    trunk, branch = last(stored, "area", "m2") / AREA, last(stored, "area_outlet_2", "m2") / AREA
    assert np.isnan(trunk).tolist() == [station == 5 for station in range(11)]
    assert trunk[[0, 1, 2, 3, 4, 6, 7, 8, 9, 10]] == pytest.approx(1.0, rel=1e-3)
    assert branch[:3] == pytest.approx(1.0, rel=1e-3)
    # the line begins to turn into the branch here
    assert branch[3] == pytest.approx(1.0, rel=1e-2)
    assert branch[7:] == pytest.approx(SMALL**2, rel=1e-3)
    # what parts the blood nowhere between both openings is no section, closed or not
    for name in ("", "_outlet_2"):
        missing = np.isnan(last(stored, f"flow{name}", "m3_s"))
        assert np.array_equal(np.isnan(last(stored, f"area{name}", "m2")), missing)
        assert np.array_equal(np.isnan(last(stored, f"wss{name}", "Pa")), missing)
        assert 1 <= missing.sum() <= 2
    assert np.array_equal(stored.of_branch("outlet_2").along("area", "m2")[-1] / AREA, branch, equal_nan=True)


def test_flow_through_sections_is_that_of_the_openings(stored: StoredRun) -> None:
    """The balance of mass holds for each section to rounding."""
    series = stored.series
    out, second = (series[f"flow_{name}_m3_s"][-1] for name in ("outlet", "outlet_2"))
    assert out + second == pytest.approx(FLOW, rel=1e-10)
    assert 0.05 * FLOW < second < 0.3 * FLOW
    trunk, branch = last(stored, "flow", "m3_s"), last(stored, "flow_outlet_2", "m3_s")
    assert trunk[:5] == pytest.approx(FLOW, rel=1e-8)
    assert trunk[6:] == pytest.approx(out, rel=1e-8)
    assert branch[:4] == pytest.approx(FLOW, rel=1e-8)
    assert branch[7:] == pytest.approx(second, rel=1e-8)


def test_what_follows_from_the_branch_s_own_flow(stored: StoredRun) -> None:
    """Away from the fork wall shear is nearly that of developed flow in each tube; the Reynolds number is the trunk's,
    and what one flow along one tube means is not there."""
    flows = {"": FLOW, "_outlet_2": stored.series["flow_outlet_2_m3_s"][-1]}
    for branch, where, radius in (("", 2, RADIUS), ("_outlet_2", 9, SMALL * RADIUS)):
        developed = 4 * BLOOD.viscosity * flows[branch] / (np.pi * radius**3)
        assert last(stored, f"wss{branch}", "Pa")[where] == pytest.approx(developed, rel=0.02)
    reynolds = BLOOD.density * FLOW / AREA * 2 * RADIUS / BLOOD.viscosity
    assert stored.series["reynolds_1"][-1] == pytest.approx(reynolds, rel=2e-3)
    assert not [name for name in stored.series if name.startswith(("sawss_poiseuille", "sawss_ellipse", "lumen_area"))]
    # the pressure on each axis falls towards its outlet
    for branch in ("", "_outlet_2"):
        pressure = last(stored, f"p_blood{branch}", "Pa")
        assert pressure[0] > 0.3
        assert abs(pressure[-1]) < 0.05 * pressure[0]


def test_cross_sections_are_stored_along_each_branch(stored: StoredRun) -> None:
    """Rings around the axis of each branch, and shapes that do not see the fork."""
    for branch, axis, radius in (("", 2, RADIUS), ("outlet_2", 0, SMALL * RADIUS)):
        view = stored.of_branch(branch) if branch else stored
        ring = view.outlines(1.0)[1][9]
        assert np.ptp(ring[:, axis]) < 0.1 * radius
        assert np.linalg.norm(np.delete(ring, axis, axis=1), axis=1) == pytest.approx(radius, rel=2e-2)
        assert len(view.shape["station"]) == 22
        assert view.shape["area_m2"][-4:-1] == pytest.approx(np.pi * radius**2, rel=1e-3)
        assert view.shape["circularity_1"][-4:-1] == pytest.approx(1.0, abs=1e-3)
        assert view.own_vessel.course.length == pytest.approx(np.sum([16e-3, (18e-3, 16e-3)[bool(branch)]]), rel=0.02)
    with pytest.raises(OutputError, match=r"no branch 'side': it has 'outlet_2'"):
        _ = stored.of_branch("side").own_vessel


def test_the_wall_of_each_branch_is_unrolled_by_itself(stored: StoredRun) -> None:
    """Beyond the fork the branch of low shear is seen alone."""
    views = stored, stored.of_branch("outlet_2")
    x, _, z = points = np.asarray(stored.fields(1.0, "wall").points, dtype=float).T
    straight, aside = (view.own_vessel.has_near(points.T) for view in views)
    assert (straight & aside)[z < -2 * RADIUS].all()
    assert (straight & ~aside)[z > 2 * RADIUS].all()
    assert (aside & ~straight)[x > 2 * RADIUS].all()
    means = [shear[positions > 26e-3].mean() for _, positions, shear in map(unroll, views)]
    walls = [last(stored, f"wss{branch}", "Pa")[9] for branch in ("", "_outlet_2")]
    assert means == pytest.approx(walls, rel=0.05)
    assert walls[1] < 0.7 * walls[0]


def test_the_report_shows_each_branch(stored: StoredRun, tmp_path: Path) -> None:
    text = report([stored.path], tmp_path / "report.html").read_text(encoding="utf-8")
    text = re.sub(r"<script.*?</script>|<style.*?</style>", "", text, flags=re.S)
    headings = re.findall(r"<h2>(.*?)</h2>", text)
    assert "Not shown" not in text
    for title in ("Along the vein: area", "Along the vein: wall shear stress", "Along the vein: flow",
                  "Outline of the lumen at mid-length", "Wall shear stress on the unrolled vein"):  # fmt: skip
        assert title in headings
        assert f"{title}, outlet_2" in headings
    assert {"Volume of the lumen", "Wall shear stress, mean", "Flow balance"} <= {*headings}
    assert not {"Why it rises", "Area of the lumen", "Wall shear stress", "Tube law"} & {*headings}
    drawn = charts.along_vein({"tee": stored.of_branch("outlet_2")}, "flow", Shown("flow", "ml_s")).data[-1]
    np.testing.assert_allclose(drawn.y, 1e6 * last(stored, "flow_outlet_2", "m3_s"), rtol=1e-12)
    assert drawn.x[-1] == pytest.approx(32.0, rel=0.02)
    with pytest.raises(OutputError, match="is branched: tube laws are of vessels with one inlet"):
        tube_laws(stored)


def test_flow_of_a_given_velocity() -> None:
    """In a cross, of velocities without divergence, which the wall has, too: through planes a . n A of a constant one,
    and of a linear one what is at their middle. The line from the second inlet leads from there to the outlet."""
    across = tuple(-np.array(Tee().outlets[1][1]))
    cross = Tee(outlets=(*Tee().outlets, ("inlet_2", across, SMALL * RADIUS)))
    flow, rest = FlowOpening(flow=FlowConstant(value=FLOW)), PressureOpening(pressure=REST)
    system = System(case_of(cross, inlet_2=flow, outlet_2=rest), domain_of(cross))
    probe = Probe(system)
    branches, z, x = probe.vessels[""].branches, [0, 0, 1], [1, 0, 0]
    ways = {name: branch.sections.normals[[1, 9]].round(1).tolist() for name, branch in branches.items()}
    assert ways == {"": [z, z], "outlet_2": [z, x], "inlet_2": [x, z]}
    for slope, constant in ((0.0, [-2.0, 0.1, 1.0]), (50.0, [0.0, 0.0, 1.0])):
        gradient, largest = slope * np.array([0.5, 0.5, -1.0]), {}
        field = ng.CF((gradient[0] * ng.x, gradient[1] * ng.y, gradient[2] * ng.z)) + ng.CF(tuple(constant))
        system.velocity_history.components[0].Set(field)
        probe.refresh()
        for name, branch in branches.items():
            # at the ends flow is relative to the openings, and at the fork the middle is not all
            normals, centres, areas = (
                values[[1, 2, 8, 9]]
                for values in (branch.sections.normals, branch.sections.centres, branch.sections.areas)
            )
            exact = np.sum(normals * (gradient * centres + constant), axis=1) * areas
            assert branch.flows[[1, 2, 8, 9]] == pytest.approx(exact, abs=2e-2 * np.abs(exact).max())
            largest[name] = np.nanmax(np.abs(branch.flows) * 2 / np.sqrt(np.pi * branch.sections.areas))
        assert slope or max(largest.values()) > 1.1 * largest[""]  # that of the constant one is in the tube across
        reynolds = max(largest.values()) * BLOOD.density / BLOOD.viscosity
        assert row(probe)["reynolds_1"] == pytest.approx(reynolds, rel=1e-9)


def test_flow_in_a_deformed_vessel() -> None:
    """Blood that moves along a sheared and stretched tube, F e_z: det F times as much as in the tube before."""
    system = System(case_of(Tee(), outlet_2=PressureOpening(pressure=REST)), domain_of(Tee()))
    F = np.array([[1.1, 0.1, 0.2], [-0.05, 0.9, -0.1], [0.15, 0.05, 1.05]])
    place = ng.CF((ng.x, ng.y, ng.z))
    system.state.components[0].Set(ng.CF(tuple(F.ravel()), dims=(3, 3)) * place - place)
    system.velocity_history.components[0].Set(ng.CF(tuple(F[:, 2])))
    flows = probe_of(system).branches[""].flows[[1, 2, 3, 7, 8, 9]]
    assert flows == pytest.approx(np.linalg.det(F) * AREA, rel=5e-3)
