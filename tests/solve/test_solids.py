"""Solids alone in 3-D, from a case file to a report: against exact solutions, with what holds, moves and loads them."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry import templates
from ngfsi_geometry.calf import CalfSegment, CalfVein
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import BareTube, TubeSegment
from ngfsi_studies.verification.radial import Layer, inner_displacement, lame

from ngfsi.case import Case, Conditions, Cuff, Discretisation, Loads, Materials, TimeStepping
from ngfsi.conditions import BodyForceModel, DisplacementModel
from ngfsi.config.functions import FactorConstant, FactorRamp, PressureConstant, PressureRamp
from ngfsi.errors import CaseError
from ngfsi.materials import CompressibleNeoHookean
from ngfsi.outlines.displacement import OutlineDisplacement
from ngfsi.report.html import report
from ngfsi.run import run
from ngfsi.store.stored import StoredRun
from ngfsi.system.system import System
from tests.geometry.test_external import cells_of, external_of, tube, without
from tests.vein import domain_of

SOFT = CompressibleNeoHookean(young=100e3, poisson=0.3, density=1060.0)
BAR = BareTube(
    hollow=True, length=20e-3, lumen_diameter=10e-3, wall_thickness=4e-3,
    mesh=MeshSettings(element="mixed", axial_layers=2, vein_size=6e-3, curving_order=3),
)  # fmt: skip
STATIC = TimeStepping(scheme="static", step=1.0, end=1.0)


def case_of(geometry: Any = BAR, law: Any = SOFT, time: TimeStepping = STATIC, **changes: Any) -> Case:
    materials = {name: law for name in ("tissue", "wall", "sheath") if name in geometry.solids}
    loads = Loads(outlet_pressure=PressureConstant(value=0.0))
    return Case(name="solids", geometry=geometry, materials=Materials(**materials), loads=loads, time=time,
                discretisation=Discretisation(order=2)).replace(**changes)  # fmt: skip


def stored(case: Case, folder: Path) -> StoredRun:
    return run(case, folder / case.name, quiet=True)


def test_the_example_follows_the_radial_equilibrium(tmp_path: Path) -> None:
    """At large strain, twice the area; unloaded again it is as before. Nothing is said of blood."""
    found = stored(Case.from_dict(tomllib.loads(templates.solid())).replace(**{"time.step": 0.5}), tmp_path)
    geometry, law = found.case.geometry, found.case.materials.wall
    inner, outer = geometry.lumen_radius, geometry.skin_radius
    area, pressure = found.series["lumen_area_mean_m2"], found.series["pressure_interface_Pa"]
    assert pressure == pytest.approx([found.case.loads.outlet_pressure(t) for t in found.series["time_s"]], rel=1e-12)
    for now, inside in zip(area[:3], pressure[:3], strict=True):
        widened = inner_displacement(inner, [Layer(law, outer)], inside) if inside else 0.0
        assert now == pytest.approx(np.pi * (inner + widened) ** 2, rel=1e-3)
    assert area[2] > 2 * area[0]
    assert area[-1] == pytest.approx(area[0], rel=1e-9)
    assert found.series["lumen_volume_m3"] == pytest.approx(area * geometry.length, rel=1e-12)
    # held where a tube that widens evenly does not move sideways
    grid = found.fields(1.0)
    x, y, _ = (grid.points - grid["displacement_m"]).T
    outwards = (x * grid["displacement_m"][:, 0] + y * grid["displacement_m"][:, 1])[np.hypot(x, y) < 1.001 * inner]
    assert np.ptp(outwards) < 0.01 * outwards.mean()

    assert not [name for name in found.series if name.startswith(("flow", "sawss", "wss", "p_blood"))]
    assert not (found.path / "wall.pvd").exists()
    text = report([found.path], tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Not shown" not in text
    assert all(f"<h2>{title}</h2>" in text for title in ("Area of the lumen", "Solids in 3-D: solid"))
    assert "<td>1</td>" in text  # when the tube is widest


def test_small_strain_is_linear(tmp_path: Path) -> None:
    """Lame's tube under pressures of a thirtieth of its stiffness: they act on the shape that is given."""
    inside, outside = 3e3, 2e3
    found = stored(case_of(**{
        "loads.outlet_pressure": PressureRamp(final=inside, duration=1.0), "discretisation.order": 3,
        "loads.skin_pressure": PressureRamp(final=outside, duration=1.0), "conditions.strain": "small",
    }), tmp_path)  # fmt: skip
    before, after = np.sqrt(found.series["lumen_area_mean_m2"] / np.pi)
    wanted = lame(BAR.lumen_radius, BAR.skin_radius, SOFT.young, SOFT.poisson, inside, outside)
    assert after - before == pytest.approx(wanted, rel=2e-3)


def test_a_wall_in_a_sheath_in_tissue(tmp_path: Path) -> None:
    """At large strain against the radial equilibrium of three layers, of which the middle one is the softest."""
    mesh = MeshSettings(element="mixed", axial_layers=1, vein_size=6e-3, curving_order=3)
    geometry = TubeSegment(
        hollow=True, length=20e-3, lumen_diameter=10e-3, outer_radius=14e-3, sheath_thickness=3e-3, mesh=mesh
    )
    laws = {"wall": SOFT, "sheath": SOFT.replace(young=5e3), "tissue": SOFT.replace(young=20e3)}
    found = stored(case_of(geometry, **{
        "materials": Materials(**laws), "loads.outlet_pressure": PressureRamp(final=6e3, duration=1.0),
        "discretisation.order": 3,
    }), tmp_path)  # fmt: skip
    layers = [Layer(law, radius) for law, radius in zip(laws.values(), (6e-3, 9e-3, 14e-3), strict=True)]
    widened = np.sqrt(found.series["lumen_area_mean_m2"][-1] / np.pi) - 5e-3
    assert widened > 0.2e-3
    assert widened == pytest.approx(inner_displacement(5e-3, layers, 6e3), rel=2e-3)


def top(found: StoredRun, time: float) -> Any:
    """Return the displacements (m) of points of the upper end."""
    grid = found.fields(time)
    before = grid.points - grid["displacement_m"]
    return np.asarray(grid["displacement_m"])[before[:, 2] > BAR.length - 1e-6]


HELD = DisplacementModel(boundaries=("wall_bottom",), displacement=(1e-4, -2e-4, 5e-4))
ON_END = {
    "conditions": Conditions(ends="free", strain="small"),
    "materials.wall": SOFT.replace(poisson=0.0),
}


def test_weight_of_a_bar_on_a_moved_end(tmp_path: Path) -> None:
    """u = d + rho g L^2 / (2 E) at the free end of a bar that hangs from one moved by d, without lateral strain."""
    weight = BodyForceModel(acceleration=(0.0, 0.0, 9.81))
    found = stored(case_of(**ON_END, **{"loads.further": (HELD, weight), "time.step": 0.5}), tmp_path)
    stretch = SOFT.density * 9.81 * BAR.length**2 / (2 * SOFT.young)
    for time in (0.5, 1.0) if len(found.field_times()) > 2 else (1.0,):
        for part, d in zip(top(found, time).T, HELD.displacement, strict=True):
            wanted = time * d + (stretch if d == HELD.displacement[2] else 0.0)
            assert part == pytest.approx(wanted, rel=1e-5)


def test_waves_in_a_bar(tmp_path: Path) -> None:
    """A force that grows from rest: q'' + w^2 q = g t/T for each mode sin(k z) of a bar held at one end."""
    end, g = 6e-3, 50.0
    force = BodyForceModel(acceleration=(0.0, 0.0, g), over_time=FactorRamp(final=1.0, duration=end))
    still = HELD.replace(over_time=FactorConstant(value=0.0))
    time = TimeStepping(step=end / 40, end=end)
    found = stored(case_of(time=time, **ON_END, **{"loads.further": (still, force)}), tmp_path)
    speed, n = np.sqrt(SOFT.young / SOFT.density), np.arange(1, 40)
    k = (n - 0.5) * np.pi / BAR.length
    w = speed * k
    wanted = np.sum(2 * g / (k * BAR.length) * np.sin(k * BAR.length) / w**2 * (end - np.sin(w * end) / w) / end)
    at_rest = SOFT.density * g * BAR.length**2 / (2 * SOFT.young)
    assert wanted > 1.1 * at_rest  # inertia carries it beyond
    assert top(found, end)[:, 2] == pytest.approx(wanted, rel=1e-2)


def test_a_mesh_without_blood(tmp_path: Path) -> None:
    """A vein in tissue whose lumen is a hole, from a file and as a geometry: the same under a cuff on the skin."""
    points, rows = cells_of(tube("mixed", 1))
    from_file = external_of(tmp_path / "solids.vtu", points, without(rows, "fluid", "inlet", "outlet"))
    cuff = Cuff(pressure=PressureRamp(final=3e3, duration=1.0), start=0.0, end=6e-3, edge=2e-3)
    found = [
        stored(
            case_of(geometry, **{"loads.cuffs": (cuff,), "name": name, "output.stability": name == "file"}), tmp_path
        )
        for name, geometry in (("file", from_file), ("made", tube("mixed", 1).replace(hollow=True)))
    ]
    for column, values in found[1].series.items():
        assert found[0].series[column] == pytest.approx(values, rel=1e-6), column
    assert found[0].series["lumen_volume_m3"][1] < 0.99 * found[0].series["lumen_volume_m3"][0]
    assert found[0].series["skin_pressure_mean_Pa"][1] == pytest.approx(3e3 * 0.6, rel=0.05)
    text = report([found[0].path], tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Not shown" not in text
    assert all(title in text for title in ("<h2>Stability</h2>", "<h2>Mode of collapse: file</h2>"))


HOLLOW: dict[str, Any] = {
    "calf": CalfSegment(hollow=True, further_veins=(CalfVein(lumen_diameter=5e-3, x=-8e-3, y=-14e-3),),
                        mesh=MeshSettings(axial_layers=2, vein_size=6e-3, far_size=40e-3)),
    "oval": TubeSegment(hollow=True, length=20e-3, aspect_ratio=1.5),
    "csg": BAR.replace(**{"mesh.element": "csg"}),
    "tetrahedra": BAR.replace(**{"mesh.element": "tetrahedron"}),
}  # fmt: skip


@pytest.mark.parametrize("name", HOLLOW)
def test_hollow_veins(name: str) -> None:
    """Solids have the volumes of the geometry (checked by Domain), and the outer normal encloses them, holes too."""
    domain = domain_of(HOLLOW[name])
    assert domain.regions == domain.geometry.solids
    assert all((v.lumen, v.openings) == (None, ()) for v in domain.vessels)
    flux = ng.CF((ng.x, ng.y, ng.z)) * domain.outer_normal()
    around = [n for n in domain.geometry.boundary_names if not n.startswith("wall_outer")]
    enclosed = float(ng.Integrate(flux * domain.ds(*around, bonus_intorder=8), domain.mesh)) / 3
    assert enclosed == pytest.approx(domain.volume(), rel=1e-6)


def test_refused() -> None:
    domain = domain_of(BAR)
    moved = OutlineDisplacement(x=(1.0, 0.0, -1.0, 0.0), y=(0.0, 1.0, 0.0, -1.0), ux=(0.0,) * 4, uy=(0.0,) * 4)
    for changes, said in (
        ({"conditions.ends": "free"}, "leaves solids without bones adrift: .* or move a boundary"),
        ({"conditions.plane_stress": ("wall",)}, "plane_stress is for plane solids"),
        ({"conditions.skin_displacement": moved}, 'skin_displacement is for plane sections: .*kind = "displacement"'),
        ({"loads.further": (HELD.replace(boundaries=("wall_botom",)),)}, "did you mean 'wall_bottom'"),
        ({"loads.further": (HELD.replace(displacement=(1.0,)),)}, "the displacement needs 3 components, not 1"),
        ({"loads.further": (BodyForceModel(acceleration=(1.0,)),)}, "the acceleration needs 3 components, not 1"),
        ({"loads.further": (BodyForceModel(acceleration=(0.0, 0.0, 1.0), regions=("fluid",)),)}, "no.* known solid"),
    ):
        with pytest.raises(CaseError, match=said):
            System(case_of(**changes), domain)


def test_written_and_read() -> None:
    further = (HELD, BodyForceModel(acceleration=(0.0, 0.0, -9.81), regions=("wall",)))
    case = case_of(**{"loads.further": further})
    written = case.to_toml_dict()["loads"]["further"]
    assert [set(one) for one in written] == [
        {"kind", "boundaries", "displacement_m", "over_time"},
        {"kind", "acceleration_m_s2", "regions", "over_time"},
    ]
    assert Case.from_dict(case.to_toml_dict()) == case
    assert case.loads.breakpoints == {0.0, 1.0}
    sentences = [one.sentence() for one in System(case, domain_of(BAR)).conditions.values()]
    assert "0 m/s2 on wall" in sentences
