"""Gradients by the adjoint: against central differences of whole runs, exact derivatives, and Taylor's second order."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import ngsolve as ng
import numpy as np
import pytest

from ngfsi.case import Case
from ngfsi.cli import main
from ngfsi.conditions import Condition, ConditionModel, ContactModel
from ngfsi.conditions.openings import ResistanceOpening, WindkesselOpening
from ngfsi.config.functions import FlowConstant, FlowTable, FlowWaveform, PressureConstant, PressureRamp, PressureTable
from ngfsi.errors import CaseError
from ngfsi.gradient import command, functionals, vectors
from ngfsi.gradient.adjoint import Gradient, StoredStates, check_even, gradient_of, same_mesh
from ngfsi.gradient.functionals import functionals_of, measured
from ngfsi.gradient.parameters import Parameter, changed, parameters_of
from ngfsi.gradient.window import Window, wanted
from ngfsi.materials.fluid.carreau_yasuda import CarreauYasuda
from ngfsi.materials.solid.varying import ByHeight
from ngfsi.materials.solid.viscosity import SolidViscosity
from ngfsi.measure.probe import Probe
from ngfsi.measure.quantities import columns
from ngfsi.mesh.domain import Domain
from ngfsi.physics.integrals import Integral
from ngfsi.registry import register
from ngfsi.solve.initial import silent
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.store.table import read_rows
from tests.seams.test_maxwell import Maxwell
from tests.solve import test_rigid, test_statics
from tests.vein import BONED, Array, case_of, domain_of

RAMPED: dict[str, Any] = {
    "loads.skin_pressure": PressureRamp(final=500.0, duration=0.1), "time.step": 0.1, "time.end": 0.2,
}  # fmt: skip
VEIN = case_of(BONED, **RAMPED)
WINDKESSEL = WindkesselOpening(
    resistance=1e8, compliance=1e-9, distal_resistance=2e8, distal_pressure=PressureConstant(value=1000.0)
)


def gradient(case: Case, quantity: str, window: Window, by: str, domain: Domain | None = None) -> Gradient:
    """Return the gradient of a run in this process."""
    return gradient_of(
        case, quantity, window, parameters_of(case, by.split(",")), domain=domain or domain_of(case.geometry)
    )


def value(case: Case, quantity: str, window: Window) -> float:
    """Return the quantity of a run."""
    run = StoredStates(case, domain_of(case.geometry), quantities=[quantity])
    return run.measured[quantity].made(window, run.times, run.values()[quantity])[0]


def moved(case: Case, parameters: Sequence[Parameter], changes: Sequence[float] | Array) -> Case:
    """Return a case with parameters changed by as much (SI)."""
    for one, change in zip(parameters, changes, strict=True):
        case = changed(case, one.path, one.value + change)
    return case


def even_changes(found: Gradient) -> Array:
    """Return changes of all parameters each of which counts as much, a millionth of the quantity, if it can without
    being large."""
    most = np.array([30 * one.step for one in found.parameters])
    slopes = np.array([found.derivatives[one.name] for one in found.parameters])
    return np.asarray(np.sign(slopes) * np.minimum(most, 1e-6 * abs(found.value) / np.maximum(np.abs(slopes), 1e-300)))


VALVE = ResistanceOpening(resistance=1e8, distal_pressure=PressureConstant(value=1700.0), valve_leakage=1e-2)

VARYING = ByHeight(parameter="young", z=(0.0, 5e-3, 10e-3), factors=(1.0, 1.5, 0.8))
WAVES = test_statics.case_of("tibia").replace(**{
    "loads.skin_pressure": PressureRamp(final=500.0, duration=4e-3), "time.step": 2e-3, "time.end": 10e-3,
    "materials.tissue.viscosity": SolidViscosity(kelvin_voigt=2.0),
})  # fmt: skip
"""A ring around a bone of which a sudden pressure makes waves, whose steps are a quarter of a period."""

CASES: dict[str, tuple[Case, str, Window, str]] = {
    "coupled": (VEIN.replace(**{"materials.tissue.viscosity": SolidViscosity(kelvin_voigt=300.0)}), "sawss",
                Window("mean", 0.1, 0.2), "materials,loads"),
    "windkessel": (VEIN.replace(**{"loads.openings": {"outlet": WINDKESSEL}}), "pressure_outlet", Window("mean"),
                   "loads.openings.outlet,loads.inlet_flow.value,materials.wall.young"),
    "table and valve": (
        VEIN.replace(**{
            "loads.skin_pressure": PressureTable(times=(0.0, 0.1, 0.2), values=(100.0, 300.0, 400.0)),
            "loads.openings": {"inlet": VALVE},
        }), "lumen_volume", Window("loss"), "loads.skin_pressure,loads.openings.inlet.resistance",
    ),
    "prestress, backflow": (
        VEIN.replace(**{"conditions.initial_state": "prestress", "loads.inlet_flow": FlowConstant(value=-1e-6),
                        "materials.tissue.viscosity": SolidViscosity(moduli=(2e3,), times=(0.1,)),
                        "materials.tissue.varying": (VARYING,)}),
        "lumen_volume", Window("end"),
        "materials.tissue.young,materials.wall.poisson,loads.outlet_pressure,loads.skin_pressure.final,"
        "materials.tissue.varying.0.factors",
    ),
    "thinning, contact": (
        VEIN.replace(**{
            "materials.fluid": CarreauYasuda(density=1060.0, viscosity_at_rest=0.056, viscosity_at_high_shear=3.5e-3,
                                             time_constant=3.3, n=0.36),
            "conditions.contact": ContactModel(), "time.end": 0.1, "time.scheme": "static",
        }), "sawss", Window("mean"), "materials.fluid.n,materials.fluid.viscosity_at_high_shear,materials.wall.young",
    ),
    "least TAWSS": (
        case_of(BONED.replace(aspect_ratio=1.5, lumen_diameter=8e-3), **RAMPED), "tawss", Window("least", 0.05, 0.2),
        "materials.fluid.viscosity,materials.wall.young,loads",
    ),
    "waves, Prony series": (WAVES.replace(**{
        "materials.tissue.viscosity": SolidViscosity(kelvin_voigt=2.0, moduli=(2e3, 1e3), times=(4e-3, 1e-3)),
        "time.scheme": "esdirk3", "time.end": 6e-3,
    }), "skin_area", Window("change"), "materials"),
    "waves, Maxwell's law": (WAVES.replace(**{
        "materials.tissue": Maxwell(density=1e3, mu=10e3, K=40e3, viscous=5e3, tau=4e-3), "time.end": 6e-3,
    }), "skin_area", Window("mean"), "materials"),
    **{f"waves, {scheme}": (WAVES.replace(**{"time.scheme": scheme}), "skin_area", Window("change"),
                            "materials,loads.skin_pressure") for scheme in ("bdf2", "esdirk3", "sdirk4")},
    "plane": (test_statics.case_of("tibia", skin=500.0).replace(**{"time.scheme": "static"}), "skin_area", Window(),
              "materials,loads.skin_pressure"),
}  # fmt: skip


WITH_ALL_PASCALS = ("coupled", "waves, bdf2", "waves, esdirk3", "waves, sdirk4")


@pytest.mark.parametrize("name", CASES)
def test_gradient_is_that_of_whole_runs(name: str) -> None:
    """Central differences along a direction in which each parameter counts as much, to 1e-6; and if all pressures,
    moduli, viscosities and densities grow by one percent, stresses do, and motions and flows stay."""
    case, quantity, window, by = CASES[name]
    found = gradient(case, quantity, window, by)
    if name in WITH_ALL_PASCALS:
        shares = found.elasticities()
        whole = sum(shares[one.name] for one in found.parameters if one.unit in ("Pa", "Pa_s", "kg_m3"))
        assert whole == pytest.approx(1.0 if found.unit == "Pa" else 0.0, abs=1e-7)
    changes = even_changes(found)
    expected = sum(found.derivatives[one.name] * change for one, change in zip(found.parameters, changes, strict=True))
    ends = [value(moved(case, found.parameters, sign * changes), quantity, window) for sign in (1, -1)]
    assert (ends[0] - ends[1]) / 2 == pytest.approx(expected, rel=1e-6, abs=0.0)


def test_remainder_of_taylors_series_is_of_second_order() -> None:
    """Along one direction of law and load, to which the area answers nonlinearly."""
    case, quantity, window, by = CASES["plane"]
    found = gradient(case, quantity, window, by)
    way = np.array([0.05 * one.value for one in found.parameters])
    slope = sum(found.derivatives[one.name] * change for one, change in zip(found.parameters, way, strict=True))
    left = [value(moved(case, found.parameters, part * way), quantity, window) - found.value - part * slope
            for part in (1.0, 0.5, 0.25)]  # fmt: skip
    orders = np.log2(np.abs(np.array(left[:-1]) / left[1:]))
    assert orders == pytest.approx(2.0, abs=0.1)
    assert abs(left[0]) > 1e-3 * abs(slope)


def test_wall_shear_of_a_pipe() -> None:
    """4 mu Q / (pi R^3): one percent more for one of viscosity or flow, three less for one of the radius."""
    case = test_rigid.case_of(test_rigid.vein(2e-3, 2e-3, layers=2), FlowConstant(value=1e-7))
    found = gradient(case, "sawss", Window(), "materials.fluid.viscosity,loads.inlet_flow")
    shares = found.elasticities()
    assert found.value == pytest.approx(test_rigid.POISEUILLE, rel=1e-2)
    assert shares["materials.fluid.viscosity"] == pytest.approx(1.0, rel=1e-4)
    assert shares["loads.inlet_flow.value"] == pytest.approx(1.0, rel=1e-4)


def test_wall_shear_by_the_radius() -> None:
    """4 mu Q / (pi R^3) in a tube that nothing deforms: three percent less for one of the radius."""
    case = VEIN.replace(**{"loads.outlet_pressure.value": 0.0, "time.scheme": "static", "time.end": 0.1})
    found = gradient(case, "sawss", Window(), "geometry.lumen_diameter")
    assert found.elasticities()["geometry.lumen_diameter"] == pytest.approx(-3.0, rel=1e-2)


def test_ring_under_pressure() -> None:
    """Lame's displacement of the skin by Young's modulus, Poisson ratio and pressure (test_statics, plane strain)."""
    inner, outer, p, law = test_statics.INNER, test_statics.OUTER, 2e3, test_statics.LAW

    def area(young: float, poisson: float, pressure: float) -> float:
        mu, lame = young / 2 / (1 + poisson), young * poisson / (1 + poisson) / (1 - 2 * poisson)
        A = -pressure / (2 * (lame + mu) + 2 * mu * (inner / outer) ** 2)
        return float(np.pi * (outer + A * outer - A * inner**2 / outer) ** 2)

    case = test_statics.case_of("tibia", skin=p, strain="small").replace(**{"time.scheme": "static"})
    by = ("materials.tissue.young", "materials.tissue.poisson", "loads.skin_pressure.value")
    found = gradient(case, "skin_area", Window(), ",".join(by))
    point = np.array([law.young, law.poisson, p])
    for number, name in enumerate(by):
        step = 1e-5 * point * (np.arange(3) == number)
        exact = (area(*point + step) - area(*point - step)) / (2 * step[number])
        assert found.derivatives[name] == pytest.approx(exact, rel=1e-4, abs=0.0), name


def test_states_on_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The gradient is the same to the last bit, whether states are in memory or not, and no file is left."""
    case, quantity, window, by = CASES["waves, esdirk3"]
    parameters = parameters_of(case, by.split(","))
    found = [gradient_of(case, quantity, window, parameters, folder=tmp_path / "out")]
    monkeypatch.setattr(vectors, "IN_MEMORY", 10 * found[0].stored_mb[0] * 1e6 / found[0].moments)
    found.append(gradient_of(case, quantity, window, parameters, folder=tmp_path / "out"))
    assert found[0].derivatives == found[1].derivatives
    assert found[0].stored_mb[1] == 0.0
    assert sum(found[1].stored_mb) == found[0].stored_mb[0]
    share = 10 / found[0].moments
    assert 0.9 * share < found[1].stored_mb[0] / found[0].stored_mb[0] <= share
    assert list((tmp_path / "out").iterdir()) == []


def test_steps_that_the_run_chooses(monkeypatch: pytest.MonkeyPatch) -> None:
    """The gradient is that of runs with the steps of the first, which are not even; and it is said."""
    case, quantity, window, _ = CASES["waves, Prony series"]
    case = case.replace(**{"time.error_tolerance": 3e-4, "time.smallest_step": 1e-4})
    found = gradient(case, quantity, window, "materials.tissue.young,materials.tissue.viscosity.moduli")
    assert "are held" in "".join(map(str, command.table(found).renderables))
    times = StoredStates(case, domain_of(case.geometry)).times
    assert np.ptp(np.diff(times)) > 0.5 * np.diff(times).min()

    def as_before(self: TimeLoop, time: float, _milestone: float) -> Any:
        self.system.accept()
        size = float(times[np.searchsorted(times, time + 1e-9)] - time)
        return size, self._attempt(time, size)

    monkeypatch.setattr(TimeLoop, "_advance", as_before)
    monkeypatch.setattr(TimeLoop, "_control", lambda *_: None)
    changes = even_changes(found)
    expected = sum(found.derivatives[one.name] * change for one, change in zip(found.parameters, changes, strict=True))
    ends = [value(moved(case, found.parameters, sign * changes), quantity, window) for sign in (1, -1)]
    assert (ends[0] - ends[1]) / 2 == pytest.approx(expected, rel=1e-6, abs=0.0)


@pytest.mark.parametrize(
    ("name", "shape"),
    [("length", {}), ("wall_thickness", {}), ("aspect_ratio", {"aspect_ratio": 1.5, "lumen_diameter": 8e-3})],
)
def test_shape_of_a_tube(name: str, shape: dict[str, float]) -> None:
    """By numbers of the geometry whose mesh keeps its elements."""
    case = case_of(BONED.replace(**shape), **{**RAMPED, "time.scheme": "static", "time.end": 0.1})
    found = gradient(case, "lumen_volume", Window(), f"geometry.{name}")
    size = getattr(case.geometry, name)
    ends = [value(changed(case, ("geometry", name), (1 + sign * 1e-3) * size), "lumen_volume", Window())
            for sign in (1, -1)]  # fmt: skip
    assert found.derivatives[f"geometry.{name}"] == pytest.approx((ends[0] - ends[1]) / 2e-3 / size, rel=1e-5)


def test_shapes_that_have_no_derivative() -> None:
    """Meshes that change by more than the places of their points, and a circle, which can become oval only."""
    case = case_of(BONED, **RAMPED)
    with pytest.raises(CaseError, match="the mesh is another one"):
        same_mesh(case.replace(**{"geometry.mesh.far_size": 9e-3}), domain_of(BONED), "geometry.mesh.far_size")
    with pytest.raises(CaseError, match=r"geometry.aspect_ratio: 1 can be varied to one side only"):
        gradient(case, "lumen_volume", Window(), "geometry.aspect_ratio")
    places, moves = np.random.default_rng(2).uniform(0.0, 0.1, (2, 20, 3))
    check_even([places + sign * 1e-6 * moves + 1e-12 * moves for sign in (1, -1)], places, "geometry.length")
    jumped = places.copy()
    jumped[7, 1] += 1e-7
    with pytest.raises(CaseError, match=r"--by geometry.length: the vertices of the mesh jump"):
        check_even([jumped + 1e-6 * moves, places - 1e-6 * moves], places, "geometry.length")
    edge = case_of(BONED.replace(aspect_ratio=2.0, lumen_diameter=8e-3), **RAMPED)  # where two edges more begin
    with pytest.raises(CaseError, match=r"geometry.aspect_ratio: the mesh is another one when it changes"):
        same_mesh(parameters_of(edge, ["geometry.aspect_ratio"])[0].varied(edge)[0], domain_of(edge.geometry),
                  "geometry.aspect_ratio")  # fmt: skip


def test_quantities_are_those_of_the_columns() -> None:
    """Whatever has a gradient has the value of its column in series.csv."""
    for case in (VEIN, CASES["plane"][0]):
        run = StoredStates(case.replace(**{"time.end": case.time.step}), domain_of(case.geometry))
        run.show(1)
        probe = Probe(run.system)
        probe.refresh()
        measures = columns(probe)
        names = [*functionals_of(run.system), *(("area_z00", "area_z05") if case is VEIN else ())]
        assert len(names) >= 2
        for name in names:
            what = measured(run.system, name)
            assert what.value() == pytest.approx(measures[f"{name}_{what.unit}"](), rel=2e-5, abs=0.0), name


def test_least_stress_of_faces() -> None:
    """Between the smallest one and what is said to be above it; derivatives are those of differences."""
    random = np.random.default_rng(3)
    forces, areas = random.uniform(1.0, 2.0, (2, 9))
    smallest = int(np.argmin(forces / areas))
    for name, average in functionals.AVERAGES.items():
        found, slopes = average(forces, areas)
        for place in range(9):
            step = 1e-6 * (np.arange(9) == place)
            ends = [(average(forces + s * step, areas)[0], average(forces, areas + s * step)[0]) for s in (1, -1)]
            assert slopes[:, place] == pytest.approx((np.array(ends[0]) - ends[1]) / 2e-6, abs=1e-8), name
    share = areas[smallest] / areas.sum()
    assert 1.0 < found * areas[smallest] / forces[smallest] < share ** (-1 / functionals.SHARPNESS)


def test_stress_over_time() -> None:
    """TAWSS is a mean of sizes: of a flow that turns around not nothing, of a wall that hardly moves SAWSS."""
    turning = FlowTable(times=(0.0, 0.1), values=(2.913e-6, -2.913e-6))
    case = VEIN.replace(**{"loads.inlet_flow": turning, "loads.skin_pressure": PressureConstant(value=0.0),
                           "time.scheme": "static", "time.step": 0.05, "time.end": 0.1})  # fmt: skip
    run = StoredStates(case, domain_of(case.geometry), quantities=["tawss", "sawss"])
    records = run.values()
    mean, least = (run.measured["tawss"].made(Window(kind), run.times, records["tawss"])[0]
                   for kind in ("mean", "least"))  # fmt: skip
    of_sawss = Window("mean").weights(run.times, records["sawss"])[0]
    assert of_sawss > 0.3 * records["sawss"][0]
    assert mean == pytest.approx(of_sawss, rel=1e-4)
    assert 0.9 * mean < least < mean
    with pytest.raises(CaseError, match="tawss_mean and tawss_least"):
        run.measured["tawss"].made(Window(), run.times, records["tawss"])


def test_area_at_a_height() -> None:
    """That of the station there; beyond the vessel there is none."""
    run = StoredStates(VEIN.replace(**{"time.end": 0.1}), domain_of(VEIN.geometry))
    station, height = measured(run.system, "area_z03"), measured(run.system, "area_at_3mm")
    assert height.value() == pytest.approx(station.value(), rel=1e-9)
    with pytest.raises(CaseError, match="11 mm is not on the centreline"):
        measured(run.system, "area_at_11mm")


@pytest.mark.parametrize("kind", ["end", "change", "loss"])
def test_a_time_between_steps(kind: str) -> None:
    """Values are linear there, and the weights are the derivatives of what is made of them."""
    times, values = np.array([0.0, 1.0, 3.0]), np.array([4.0, 3.0, 1.0])
    window = Window(kind, end=2.5)
    found, weights = window.weights(times, values)
    assert found == pytest.approx({"end": 1.5, "change": -2.5, "loss": 0.625}[kind], rel=1e-12)
    for place, step in enumerate(1e-6 * np.eye(3)):
        ends = [window.weights(times, values + sign * step)[0] for sign in (1, -1)]
        assert weights[place] == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-8)
    whole, last = Window(kind).weights(times, values), Window(kind, end=3.0).weights(times, values)
    assert whole[0] == last[0]
    assert whole[1] == pytest.approx(last[1], rel=1e-12)


class HiddenSpring(Condition):
    """Springs on the skin whose stiffness follows the state without being an unknown."""

    name = "springs"

    def __init__(self) -> None:
        self._stiffness = ng.Parameter(0.0)

    def prescribe(self, values: Array) -> None:
        self._stiffness.Set(1e9 * float(np.abs(values[: len(values) // 8]).sum()))

    def static_integrals(self, m: Any, v: Any) -> list[Integral]:
        work = self._stiffness * ng.InnerProduct(m.Trace(), v.Trace())
        return [Integral([work], self._setup.domain.ds("skin"))]


@register("ngfsi.conditions", "hidden_springs")
class HiddenSprings(ConditionModel):
    kind: Literal["hidden_springs"] = "hidden_springs"

    def condition(self, _domain: Domain, _name: str) -> Condition:
        return HiddenSpring()


def test_a_mean_over_parts_of_steps() -> None:
    """Values are linear between steps; a window without length is a time."""
    times, values = np.array([0.0, 1.0, 3.0]), np.array([4.0, 3.0, 1.0])
    found, weights = Window("mean", 0.5, 2.0).weights(times, values)
    assert found == pytest.approx((1.625 + 2.5) / 1.5, rel=1e-12)
    assert weights == pytest.approx(np.array([0.125, 1.125, 0.25]) / 1.5, rel=1e-12)
    assert Window("mean", 1.0, 9.0).weights(times, values)[1] == pytest.approx([0.0, 0.5, 0.5])
    assert Window("mean", 2.0, 2.0).weights(times, values)[0] == pytest.approx(2.0, rel=1e-12)


def test_numbers_that_are_parameters() -> None:
    """All that can vary: a waveform is closed by its first value, and a density of 0 has no less."""
    wave = FlowWaveform(times=(0.0, 0.2, 0.5, 1.0), values=(1e-6, 3e-6, 2e-6, 1e-6))
    case = VEIN.replace(**{"loads.inlet_flow": wave, "materials.wall.density": 0.0})
    found = parameters_of(case, ["loads.inlet_flow", "materials.wall"])
    assert [one.name for one in found] == [*(f"loads.inlet_flow.values.{n}" for n in range(3)), "materials.wall.young",
                                           "materials.wall.poisson"]  # fmt: skip
    assert found[0].varied(case)[0].loads.inlet_flow.values == pytest.approx(  # type: ignore[attr-defined]
        (1.00001e-6, 3e-6, 2e-6, 1.00001e-6), rel=1e-9, abs=0.0
    )
    with pytest.raises(CaseError, match="to one side only"):
        parameters_of(case, ["materials.wall.density"])[0].varied(case)


REFUSED: dict[str, tuple[dict[str, Any], str, str, str]] = {
    "an unknown dependence": ({"loads.further": (HiddenSprings(),)}, "lumen_volume", "materials",
                              "something depends on the state in a way that a gradient does not know"),
    "one way": ({"conditions.coupling": "one_way"}, "lumen_volume", "materials", "use conditions.coupling"),
    "solver": ({"solver.linear": "p_multigrid"}, "lumen_volume", "materials", "use 'auto'"),
    "quantity": ({}, "wss_max", "materials", "'wss_max' is not a known quantity with a gradient"),
    "a time": ({}, "lumen_volume", "loads.skin_pressure.duration", "there is no number"),
    "no parameter": ({}, "lumen_volume", "solver.tolerance", "'solver' is not a known part"),
    "no key": ({}, "lumen_volume", "materials.tissue.E", "'E' is not a known key"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_known_is_refused(name: str) -> None:
    changes, quantity, by, sentence = REFUSED[name]
    case = VEIN.replace(**changes, **{"time.end": 0.1})
    with pytest.raises(CaseError, match=re.escape(sentence)):
        gradient_of(case, quantity, Window(), parameters_of(case, [by]))


def test_command(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Sorted by what counts most, in the terminal and in a file, with a chart."""
    (tmp_path / "case.toml").write_text(VEIN.to_toml())
    arguments = ["gradient", str(tmp_path / "case.toml"), "--of", "sawss_mean", "--window", "0.1,0.2", "--quiet",
                 "--by", "materials.wall,loads.inlet_flow", "-o", str(tmp_path / "out")]  # fmt: skip
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert not ended.value.code
    rows = read_rows(tmp_path / "out" / "gradient.csv")
    assert {row["parameter"] for row in rows[1:]} == {
        f"materials.wall.{name}" for name in ("young", "poisson", "density")
    }
    assert rows[0]["parameter"] == "loads.inlet_flow.value"
    sizes = [abs(float(row["elasticity"])) for row in rows]
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[0] == pytest.approx(0.96875, abs=1e-4)
    shown = capsys.readouterr().out
    assert "sawss_mean = 0.0" in shown
    assert shown.index("loads.inlet_flow.value") < shown.index("materials.wall.young")
    assert (tmp_path / "out" / "gradient.png").stat().st_size > 1000
    assert wanted("lumen_volume_loss", command.KINDS) == ("lumen_volume", "loss")
    assert wanted("area_z05", command.KINDS) == ("area_z05", "end")


@pytest.mark.parametrize(("window", "sentence"), [("1", "two times in seconds"), ("7,8", "holds no time of the run")])
def test_windows_that_are_none(window: str, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(CaseError, match=sentence):
        command.gradient(CASES["plane"][0], "skin_area_mean", "materials", window, tmp_path / "out", silent)
