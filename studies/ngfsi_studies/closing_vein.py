"""Why do veins of legs lose more than half of their area under a stocking, and the round vein of the source a fifth?

The calf of `compare_tissues` with a vein of the same area that is oval, one factor changed at a time: under 25 mmHg
that rise smoothly in 1 s with constant flow, at rest under pressures that close it, fed by a pressure behind a
resistance so that closing stops the flow, and under 120 mmHg and none again. Then several factors at once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ngfsi.case import Case
from ngfsi.conditions import ContactModel, ResistanceOpening, StockingModel
from ngfsi.config.functions import (
    FactorSmoothRamp,
    Hydrostatic,
    Posture,
    PressureConstant,
    PressureCurve,
    PressureSmoothRamp,
    PressureTable,
)
from ngfsi.materials import load_set
from ngfsi.report.render import animation
from ngfsi.report.tables import markdown_table
from ngfsi.report.terminal import console
from ngfsi.store.stored import StoredRun
from ngfsi.store.table import write_rows
from ngfsi.study import Outcome, run_cases, write_page
from ngfsi.study.design import sobol
from ngfsi.units import MMHG, Shown, from_si
from ngfsi_studies import compare_tissues
from ngfsi_studies.figures import Group, Line, lines, outlines
from ngfsi_studies.source import tables

Array = NDArray[np.float64]

FULL = 25 * MMHG
"""Pressure on the skin (Pa) of the rise."""
RATIO = 3.2
"""Of the oval vein's axes: an example. What it was in the legs of those who were measured is not printed."""
WALL = load_set("vein_wall").replace(label="")
"""Its constants are varied, so that the name of the set does not stay."""
CAPILLARIES = 15 * MMHG
"""By how much the pressure behind the resistance that feeds the vein exceeds that of its outlet (Pa)."""
FULLEST = 120 * MMHG
"""Highest pressure of the veins that are closed in a second and let go again (Pa)."""
CLOSED = 0.1
"""Fraction of the area at rest below which a vein counts as closed."""


class Level(NamedTuple):
    """How finely to compute: mesh and order of a level of compare_tissues.py, steps of the rise (s) and of the pressure
    at rest (Pa), whether veins are opened again, and how many have all factors at once; `points`: which veins; none:
    all."""

    mesh: compare_tissues.Level
    step: float
    pressure_step: float
    reopens: bool
    design: int
    points: tuple[str, ...] = ()

    def chosen(self) -> dict[str, Point]:
        """Return the veins by key."""
        return {key: POINTS[key] for key in self.points or POINTS}


LEVELS = {
    "demo": Level(compare_tissues.COARSE, 0.05, 5 * MMHG, False, 4, ("oval", "round", "ratio_4", "halved", "gap")),
    "paper": Level(compare_tissues.LEVELS["demo"], 0.05, 5 * MMHG, True, 16),
}
"""Veins with all factors at once, those that open again, and those that say so where they are closed, are computed on
the mesh of the former."""


@dataclass(frozen=True)
class Point:
    """A vein: what is special about it, and the changes of the case; `closes`: the pressure at rest (mmHg) to which it
    is to be closed; `reopens`: whether it is to be closed in a second and let go; `numerical`: the same vein computed
    otherwise; `rises`: whether it is to be pressed within 1 s; `coarse`: whether the mesh of level `demo` is to do
    where it is closed; `upright`: the posture that a lying leg takes before it is closed."""

    title: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    closes: float = 0.0
    numerical: bool = False
    reopens: bool = False
    rises: bool = True
    coarse: bool = False
    upright: Posture | None = None


def _blood(mmhg: float) -> dict[str, Any]:
    return {"loads.outlet_pressure": PressureConstant(value=mmhg * MMHG)}


def _posture(posture: Posture) -> dict[str, Any]:
    return {"loads.outlet_pressure": Hydrostatic(posture=posture), "conditions.initial_state": "prestress"}


TAPER = {"geometry.skin_radius_distal": 49e-3, "geometry.skin_radius_proximal": 61e-3, "geometry.tibia_y": 15e-3}
"""Of a calf whose girth grows from 31 to 38 cm, its tibia deep enough for that; the mean radius is the same."""
THINNER, MEAN = 49e-3, 55e-3
REVERSED = 0.6
"""Pressure of the stocking with a reversed gradient where the calf is thinner, over the mean."""


def _stocking(*tension: float) -> dict[str, Any]:
    """Return the changes for a stocking of a tension (N/m) at the lower end and, if it is another, the upper one."""
    worn = StockingModel(tension=tension, heights=(0.0, 0.12) if len(tension) > 1 else (),
                         over_time=FactorSmoothRamp(final=1.0, duration=1.0))  # fmt: skip
    return {**TAPER, "loads.skin_pressure": PressureConstant(value=0.0), "loads.further": (worn,)}


SHEATH = {"geometry.sheath_thickness": 2e-3, "materials.sheath": load_set("loose_connective_tissue")}
"""Closed to 11 % of its area at 39.3 mmHg, beyond which Newton's method finds no state at rest; on the coarse mesh it
does."""

BASE = "oval"
UPRIGHT: dict[Posture, float] = {"sitting": 110.0, "standing": 150.0}
"""Up to which pressure (mmHg) legs of other postures are to be closed."""
RISING = 20.0
"""Seconds, of a sequence of states at rest, in which such a leg gets up: the pressure of its blood grows."""
POINTS: dict[str, Point] = {
    BASE: Point("3.2 : 1", closes=60, reopens=True),
    "round": Point("round", {"geometry.aspect_ratio": 1.0}, closes=60, reopens=True),
    "ratio_2": Point("2.25 : 1", {"geometry.aspect_ratio": 2.25}, closes=60),
    "ratio_4": Point("4.5 : 1", {"geometry.aspect_ratio": 4.5}),
    "turned": Point("turned by 90 degrees", {"geometry.oval_direction": np.pi / 2}),
    "blood_2": Point("blood at 2 mmHg", _blood(2), closes=60),
    "blood_5": Point("blood at 5 mmHg", _blood(5), closes=60),
    "blood_15": Point("blood at 15 mmHg", _blood(15), closes=60),
    "lying": Point("lying, of this shape under its blood", _posture("lying"), closes=60),
    **{
        one: Point(
            f"{one}, of this shape while lying", _posture("lying"), closes=end, rises=False, coarse=True, upright=one
        )
        for one, end in UPRIGHT.items()
    },
    "wall_soft": Point("wall half as stiff", {"materials.wall": WALL.replace(young=66.5e3)}),
    "wall_stiff": Point("wall twice as stiff", {"materials.wall": WALL.replace(young=266e3)}),
    "wall_thin": Point("wall of 0.5 mm", {"geometry.wall_thickness": 0.5e-3}),
    "sheath": Point("in a sheath of 2 mm, 5 kPa", SHEATH, closes=39),
    "sheath_coarse": Point("in a sheath of 2 mm, on the coarse mesh", SHEATH, closes=45, rises=False, coarse=True),
    "tissue_stiff": Point("M with K 82 kPa", {"materials.tissue": load_set("mooney_rivlin_s1").replace(K=82e3)}),
    "tissue_n": Point("N, likely constants", {"materials.tissue": load_set("neo_hookean_likely")}),
    "wall_source": Point("wall of Saint Venant-Kirchhoff's law", {"materials.wall": load_set("vein_wall_source")}),
    "tapering": Point("calf that tapers", TAPER),
    "stocking": Point("calf that tapers, stocking of even tension", _stocking(FULL * MEAN)),
    "reversed": Point(
        "calf that tapers, stocking of reversed gradient",
        _stocking(REVERSED * FULL * THINNER, 2 * FULL * MEAN - REVERSED * FULL * THINNER),
    ),
    "order": Point("3.2 : 1, one order more", numerical=True),
    "halved": Point("3.2 : 1, half of the step", numerical=True),
    "gap": Point(
        "3.2 : 1, half of the residual gap", {"conditions.contact.residual_gap": 0.01}, closes=60, numerical=True
    ),
    "coarse": Point("3.2 : 1, on the coarse mesh", closes=60, numerical=True, rises=False, coarse=True),
}


RANGES = {
    "geometry.aspect_ratio": (1.5, 4.5),
    "geometry.wall_thickness_mm": (0.5, 1.5),
    "loads.outlet_pressure.value_mmHg": (2.0, 15.0),
    "materials.wall.young_kPa": (66.5, 266.0),
    "materials.tissue.K_kPa": (20.0, 82.0),
}
"""Of the factors that are varied at once: shapes between the source's round vein and what else is computed here; walls
of half and twice the source's; its blood pressures; bulk moduli from its calibration to those of the group quoted."""
VARIED = ("ratio of the axes", "thickness of the wall [mm]", "pressure of the blood [mmHg]",
          "Young's modulus of the wall [kPa]", "K of the tissue [kPa]")  # fmt: skip
"""The same in words."""
SEED = 7
FEWEST_RANKED = 16
"""Veins with all factors at once whose ranks say anything: among the first eight the factors follow each other."""


def design(level: Level) -> dict[str, Case]:
    """Return veins with all factors at once, evenly spread in their ranges."""
    return {
        f"all-{number}": one.replace(name=f"all-{number}")
        for number, one in sobol(RANGES, level.design, SEED).cases(case(BASE, LEVELS["demo"])).items()
    }


def case(key: str, level: Level) -> Case:
    """Return the case of a vein under 25 mmHg that rise in 1 s."""
    point = POINTS[key]
    order = level.mesh.order + (key == "order")  # around an oval the tips, not the sizes asked for, set the elements
    mesh = level.mesh.mesh.replace(curving_order=order)
    base = compare_tissues.case("m_s1", level.mesh._replace(mesh=mesh, order=order))
    step = level.step / 2 if key == "halved" else level.step
    return base.replace(**{
        "name": key.replace("_", "-"), "geometry.aspect_ratio": RATIO, "materials.wall": WALL,
        "conditions.contact": ContactModel(),
        "loads.skin_pressure": PressureSmoothRamp(final=FULL, duration=1.0),
        "time.step": step, "time.smallest_step": step / 64, "time.end": 1.0, "output.fields_every": round(0.25 / step),
    }).replace(**point.changes)  # fmt: skip


def closing_case(key: str, level: Level) -> Case:
    """Return the case of a vein at rest under a pressure on the skin that rises by 1 mmHg in each second, in legs that
    are upright once their blood has that pressure.

    The pressure behind the resistance that feeds it is such that without that pressure the flow is the same.
    """
    rise, end, posture = case(key, level), POINTS[key].closes, POINTS[key].upright
    start = RISING if posture else 0.0
    lying = rise.loads.outlet_pressure(0.0)
    blood: PressureCurve = rise.loads.outlet_pressure
    behind: PressureCurve = PressureConstant(value=lying + CAPILLARIES)
    if posture:
        times, values = (0.0, RISING), (lying, Hydrostatic(posture=posture)(0.0))
        blood = PressureTable(times=times, values=values)
        behind = PressureTable(times=times, values=tuple(one + CAPILLARIES for one in values))
    source = ResistanceOpening(resistance=CAPILLARIES / rise.loads.inlet_flow(0.0), distal_pressure=behind)
    step = from_si(level.pressure_step, "mmHg")
    return rise.replace(**{
        "name": f"{rise.name}-closing", "loads.openings": {"inlet": source},
        "loads.outlet_pressure": blood,
        "loads.skin_pressure": PressureTable(times=(start, start + end), values=(0.0, end * MMHG)),
        "time.scheme": "static", "time.step": step, "time.smallest_step": step / 64, "time.end": start + end,
        "output.fields_every": 2,
    })  # fmt: skip


def reopening_case(key: str) -> Case:
    """Return the case of a vein under 120 mmHg that rise in 1 s, fall in as much, and let it open again."""
    return case(key, LEVELS["demo"]).replace(**{
        "name": f"{key}-reopening", "time.step": 0.02, "time.smallest_step": 0.02 / 256, "time.end": 4.0,
        "loads.skin_pressure": PressureTable(times=(0.0, 1.0, 2.0), values=(0.0, FULLEST, 0.0)),
        "output.fields_every": 5,
    })  # fmt: skip


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Run the study at a level into a folder and return the path of the report."""
    chosen = LEVELS[level]
    points = chosen.chosen()
    cases = {key: case(key, chosen) for key, point in points.items() if point.rises}
    cases |= {
        f"{key}-closing": closing_case(key, LEVELS["demo"] if point.coarse else chosen)
        for key, point in points.items() if point.closes
    }  # fmt: skip
    if chosen.reopens:
        cases |= {f"{key}-reopening": reopening_case(key) for key, point in points.items() if point.reopens}
    cases |= design(chosen)
    path = write_report(level, folder, run_cases(cases, folder, quiet=quiet))
    if not quiet:
        console().print(path.read_text(encoding="utf-8").partition("\n\n")[2].partition("\n\n")[0])
    return path


@dataclass(frozen=True)
class Result:
    """The numbers of a vein, NaN where it was not computed: loss of volume and SAWSS over that at t = 0, at the end of
    the rise; of the veins that are
    closed the same of SAWSS in steady flow under the same pressure, the pressure on the skin at which they count as
    closed, and how much of the flow is left there; the area at t = 0, and of veins that are let go again the area under
    the highest pressure and in the end, over that."""

    key: str
    loss_1: float = float("nan")
    sawss_start_Pa: float = float("nan")  # noqa: N815 - a column
    sawss_ratio_1: float = float("nan")
    least_detf_1: float = float("nan")
    closed_Pa: float = float("nan")  # noqa: N815 - a column
    flow_left_1: float = float("nan")
    steady_ratio_1: float = float("nan")
    area_start_m2: float = float("nan")
    pressed_1: float = float("nan")
    reopened_1: float = float("nan")


def result(key: str, run: StoredRun | None, closing: StoredRun | None, reopening: StoredRun | None) -> Result:
    """Return the numbers of a vein."""
    if run is None:
        closed, left = pressure_of_closure(closing) if closing else (np.nan, np.nan)
        return Result(key, closed_Pa=closed, flow_left_1=left)
    area, shear = run.series["lumen_area_mean_m2"], run.series["sawss_Pa"]
    least = min(np.nanmin(values) for name, values in run.series.items() if name.startswith("detF_min"))
    closed, left = pressure_of_closure(closing) if closing else (np.nan, np.nan)
    steady = steady_ratio(closing) if closing else np.nan
    loss, ratio = float(1 - area[-1] / area[0]), float(shear[-1] / shear[0])
    pressed, reopened = _reopened(reopening) if reopening else (np.nan, np.nan)
    return Result(
        key, loss, float(shear[0]), ratio, float(least), closed, left, steady, float(area[0]), pressed, reopened
    )


def _reopened(run: StoredRun) -> tuple[float, float]:
    """Return the area at the highest pressure and in the end, over that at rest."""
    area, highest = run.series["lumen_area_mean_m2"], np.argmax(run.series["skin_pressure_mean_Pa"])
    return float(area[highest] / area[0]), float(area[-1] / area[0])


def steady_ratio(run: StoredRun) -> float:
    """Return SAWSS in steady flow under the full pressure over that without pressure."""
    shear = run.series["sawss_Pa"]
    return float(np.interp(FULL, run.series["skin_pressure_mean_Pa"], shear) / shear[0])


def pressure_of_closure(run: StoredRun) -> tuple[float, float]:
    """Return the pressure on the skin (Pa) at which the mean area falls below a tenth of that before it rises, between
    steps in a straight line, and the fraction of the flow that is left there; NaN: at none."""
    series = run.series
    before = np.flatnonzero(series["skin_pressure_mean_Pa"] == 0.0)[-1]
    left = series["lumen_area_mean_m2"] / series["lumen_area_mean_m2"][before]
    below = np.flatnonzero(left < CLOSED)
    if not len(below):
        return float("nan"), float("nan")
    ends = slice(below[0] - 1, below[0] + 1)
    part = (left[ends][0] - CLOSED) / (left[ends][0] - left[ends][1])
    pressure, flow = (
        np.interp(part, (0, 1), series[name][ends]) for name in ("skin_pressure_mean_Pa", "flow_out_m3_s")
    )
    return float(pressure), float(flow / series["flow_out_m3_s"][before])


class Measured(NamedTuple):
    """What others measured: who on whom, in which posture (none: lying), under what, and the range of means in percent
    or mmHg."""

    who: str
    load: str
    low: float
    high: float
    upright: Posture | None = None

    @property
    def range(self) -> str:
        """The range in words."""
        return f"{self.low:g}" if self.low == self.high else f"{self.low:g} to {self.high:g}"


def measured(name: str) -> list[Measured]:
    """Return what others measured of loss_percent, rise_percent or closed_mmHg, the last by posture."""
    found = []
    for one in tables("measured"):
        given = one.get(name, {})
        postures = given if isinstance(given, dict) else {"": given}
        for posture, value in postures.items():
            low, high = value if isinstance(value, list) else (value, value)
            who = f"{one['source'].partition(',')[0].partition(' (')[0]}: {one['who']}"
            found.append(
                Measured(
                    f"{who}, {posture}" if posture else who,
                    one["load"],
                    low,
                    high,
                    next((one for one in UPRIGHT if one == posture), None),
                )
            )
    return found


def write_report(level: str, folder: Path, outcomes: Mapping[str, Outcome]) -> Path:
    """Write report.md, results.csv and the figures from what became of the runs, and return the report's path."""
    done = {key: one.run for key, one in outcomes.items() if one.run is not None and not one.failure}
    results = {
        key: result(key, done.get(key), done.get(f"{key}-closing"), done.get(f"{key}-reopening"))
        for key in POINTS if key in done or f"{key}-closing" in done
    }  # fmt: skip
    at_once = {key: Designed.of(run) for key, run in done.items() if key.startswith("all-")}
    files = []
    if results:
        write_rows(folder / "results.csv", [asdict(one) for one in results.values()])
        write_rows(folder / "design.csv", [asdict(one) for one in at_once.values()])
        files = _draw(results, list(at_once.values()), done, folder)
    parts = [
        f"# Veins that close, level `{level}`\n", answer(results), *files, "## One factor at a time\n", table(results),
        "Under 25 mmHg on the skin that rise smoothly in 1 s; M tissue, wall of 1 mm and 133 kPa with the law "
        "`compressible_neo_hookean`, blood at 10 mmHg, flow 2.913 ml/s, lumen of the area of a circle of 11.1 mm, "
        "longer axis lateral, unless the first column says otherwise. Closed: the mean area is below a tenth of that "
        "at rest, in steady flow from a source 15 mmHg above the outlet behind a resistance.\n",
        *(["## All factors at once\n", spread(list(at_once.values()))] if at_once else []),
        "## What others measured\n", comparison(results),
        "## Cost of contact\n", cost({key: run for key, run in done.items() if key.endswith("-closing")}),
    ]  # fmt: skip
    return write_page(folder, "closing_vein", level, parts, outcomes)


def numerical_changes(results: Mapping[str, Result], name: str) -> dict[str, float]:
    """Return the changes of a number of the oval vein with mesh or order, step and gap, where they are known."""
    changes = {
        key: abs(getattr(results[key], name) - getattr(results[BASE], name))
        for key, point in POINTS.items() if point.numerical and key in results
    }  # fmt: skip
    return {key: change for key, change in changes.items() if np.isfinite(change)}


def numerical_error(results: Mapping[str, Result], name: str) -> float:
    """Return the estimated error of a number of the oval vein, the sum of its changes; NaN where that with the mesh or
    the order is not known."""
    known = numerical_changes(results, name)
    return sum(known.values()) if {"order", "coarse"} & known.keys() else float("nan")


def answer(results: Mapping[str, Result]) -> str:
    """Return what the shape of the vein decides, in sentences."""
    if not {BASE, "round"} <= results.keys():
        return "The runs that answer the question failed.\n"
    oval, around = results[BASE], results["round"]
    losses, ratios = numerical_error(results, "loss_1"), numerical_error(results, "sawss_ratio_1")
    said = [
        f"- **With M tissue the shape of the vein is enough.** Under 25 mmHg a round vein loses "
        f"{100 * around.loss_1:.1f} % of its volume and its SAWSS ends at {around.sawss_ratio_1:.2f} times that at "
        f"rest; an oval one of the same area, {RATIO:g} : 1, loses "
        f"{with_error(100 * oval.loss_1, 100 * losses)} % and ends at "
        f"{with_error(oval.sawss_ratio_1, ratios)} times, of which the blood that the vein still expels has a part: "
        f"in steady flow under the same pressure it is {oval.steady_ratio_1:.1f} times. Measured under stockings: "
        f"{', '.join(one.range for one in measured('loss_percent'))} %; on the source's images of a subject "
        f"{tables('compare_tissues')['volume_reduction_percent']['measured']:g} %.",
    ]
    others = (BASE, "round")
    physical = [
        one for key, one in results.items()
        if not POINTS[key].numerical and key not in others and np.isfinite(one.loss_1)
    ]  # fmt: skip
    if physical:
        least, most = min(physical, key=lambda one: one.loss_1), max(physical, key=lambda one: one.loss_1)
        said.append(
            f"- **Other factors**, one at a time around the oval vein, give losses from {100 * least.loss_1:.0f} % "
            f"({POINTS[least.key].title}) to {100 * most.loss_1:.0f} % ({POINTS[most.key].title})."
        )
    if {"tapering", "stocking", "reversed"} <= results.keys():
        even, worn, reverse = (100 * results[key].loss_1 for key in ("tapering", "stocking", "reversed"))
        said.append(
            f"- **By girth**: on a calf that tapers, 25 mmHg everywhere take {even:.1f} %, a stocking of even tension "
            f"and the same mean pressure, which presses more where the calf is thinner, {worn:.1f} %, and one of "
            f"reversed gradient {reverse:.1f} %."
        )
    closed = [
        one for key, one in results.items()
        if np.isfinite(one.closed_Pa) and not (POINTS[key].numerical or POINTS[key].upright)
    ]  # fmt: skip
    if closed:
        listed = ", ".join(f"{from_si(one.closed_Pa, 'mmHg'):.0f} mmHg ({POINTS[one.key].title})" for one in closed)
        said.append(f"- **It closes** at {listed}.")
    if np.isfinite(error := numerical_error(results, "closed_Pa")):
        found = with_error(from_si(oval.closed_Pa, "mmHg"), from_si(error, "mmHg"))
        changes = " and ".join(
            f"{from_si(change, 'mmHg'):.1f} mmHg ({POINTS[key].title.partition(', ')[2]})"
            for key, change in numerical_changes(results, "closed_Pa").items()
        )
        said.append(f"- **Error of that pressure**: {found} mmHg for {RATIO:g} : 1; it changes by {changes}.")
    said += by_posture(results)
    for one in (one for one in (oval, around) if np.isfinite(one.reopened_1)):
        said.append(
            f"- **It opens again**: {POINTS[one.key].title}, closed to {100 * one.pressed_1:.1f} % of its area by "
            f"{from_si(FULLEST, 'mmHg'):.0f} mmHg in 1 s and let go in another, it has "
            f"{100 * one.reopened_1:.1f} % of it 2 s later."
        )
    if (stretch := compliance(results)) > 0:
        (known,) = measured("compliance_1_mmHg")
        said.append(
            f"- **Its compliance at rest** is {stretch:.4f} of its area per mmHg, between blood at 5 and 15 mmHg; "
            f"measured {known.range} ({known.who})."
        )
    return "\n".join(said) + "\n"


def by_posture(results: Mapping[str, Result]) -> list[str]:
    """Return at which pressure veins of legs that lie, sit and stand close, and at which others saw it, if known."""
    postures: tuple[Posture, ...] = ("lying", *UPRIGHT)
    found = []
    for posture in postures:
        if posture in results and np.isfinite(results[posture].closed_Pa):
            closed, blood = (CLOSURE(one) for one in (results[posture].closed_Pa, Hydrostatic(posture=posture)(0.0)))
            seen = ", ".join(one.range for one in measured("closed_mmHg") if one.upright == POINTS[posture].upright)
            found.append(f"{posture}, blood at {blood:.0f} mmHg, {closed:.0f} mmHg (measured {seen})")
    if not found:
        return []
    return [f"- **By posture**, in a leg whose vein has this shape while lying: {'; '.join(found)}."]


def compliance(results: Mapping[str, Result]) -> float:
    """Return the change of the oval vein's area at rest with the pressure of its blood, over its area (1/mmHg)."""
    if not {BASE, "blood_5", "blood_15"} <= results.keys():
        return float("nan")
    low, middle, high = (results[key].area_start_m2 for key in ("blood_5", BASE, "blood_15"))
    return (high - low) / (10 * middle)


@dataclass(frozen=True)
class Designed:
    """A vein with all factors at once, and what becomes of it."""

    ratio_1: float
    wall_thickness_m: float
    blood_Pa: float  # noqa: N815 - a column
    wall_young_Pa: float  # noqa: N815 - a column
    bulk_Pa: float  # noqa: N815 - a column
    loss_1: float
    sawss_ratio_1: float

    @classmethod
    def of(cls, run: StoredRun) -> Designed:
        """Return that of a run."""
        geometry, materials, blood = run.case.geometry, run.case.materials, run.case.loads.outlet_pressure(0.0)
        wall, tissue = materials.law_of("wall").model_dump(), materials.law_of("tissue").model_dump()
        area, shear = run.series["lumen_area_mean_m2"], run.series["sawss_Pa"]
        return cls(geometry.aspect_ratio, geometry.wall_thickness, blood, wall["young"], tissue["K"],
                   float(1 - area[-1] / area[0]), float(shear[-1] / shear[0]))  # fmt: skip


def spread(designed: Sequence[Designed]) -> str:
    """Return what all factors at once make of the loss, and which of them it follows, in sentences."""
    losses = np.array([one.loss_1 for one in designed])
    lowest, middle, highest = 100 * np.quantile(losses, (0, 0.5, 1))
    ranges = ", ".join(f"{what} {low:g} to {high:g}" for what, (low, high) in zip(VARIED, RANGES.values(), strict=True))
    said = (
        f"{len(designed)} veins spread evenly over {ranges}: they lose {lowest:.0f} to {highest:.0f} %, half of them "
        f"more than {middle:.0f} %."
    )
    names = list(asdict(designed[0]))[: len(RANGES)]
    if len(designed) >= FEWEST_RANKED:
        from scipy.stats import spearmanr

        ranks = [float(spearmanr([getattr(one, name) for one in designed], losses).statistic) for name in names]
        named = sorted(zip(VARIED, ranks, strict=True), key=lambda pair: -abs(pair[1]))
        listed = ", ".join(f"{what.partition(' [')[0]} {rank:+.2f}" for what, rank in named)
        said += f" Rank correlation of the loss with each (Spearman): {listed}."
    return said + "\n"


def with_error(value: float, error: float) -> str:
    """Return a number with its error, to the first digit of the error, or without one if that is not known."""
    if not np.isfinite(error):
        return f"{value:.1f}"
    digits = max(0, 1 - int(np.floor(np.log10(error)) + 1)) if error > 0 else 1
    return f"{value:.{digits}f} ± {error:.{digits}f}"


LOSS, SHEAR, CLOSURE = (Shown(name, unit) for name, unit in (
    ("loss", "percent"), ("SAWSS at t = 0", "Pa"), ("closed at", "mmHg")))  # fmt: skip


def table(results: Mapping[str, Result]) -> str:
    """Return all veins."""
    head = ("vein", LOSS.label, SHEAR.label, "SAWSS at the end over that", "in steady flow", CLOSURE.label,
            "flow left then", "least det F")  # fmt: skip
    cells = [
        (
            POINTS[one.key].title, _if_known(LOSS(one.loss_1), ".1f"), _if_known(SHEAR(one.sawss_start_Pa), ".4f"),
            *(_if_known(value, spec) for value, spec in (
                (one.sawss_ratio_1, ".2f"), (one.steady_ratio_1, ".2f"), (CLOSURE(one.closed_Pa), ".1f"),
                (one.flow_left_1, ".2f"), (one.least_detf_1, ".3f"))),
        )
        for one in results.values()
    ]  # fmt: skip
    return markdown_table(head, cells)


def _if_known(value: float, spec: str) -> str:
    return format(value, spec) if np.isfinite(value) else ""


def comparison(results: Mapping[str, Result]) -> str:
    """Return what others measured beside the range of all veins in that posture."""
    oval = results.get(BASE)
    found: dict[str, tuple[str, Callable[[Result], float]]] = {
        "loss_percent": ("loss %", lambda one: 100 * one.loss_1),
        "rise_percent": ("rise of SAWSS %", lambda one: 100 * (one.sawss_ratio_1 - 1)),
        "closed_mmHg": (CLOSURE.label, lambda one: CLOSURE(one.closed_Pa)),
        "compliance_1_mmHg": (
            "compliance at rest [1/mmHg]",
            lambda one: compliance(results) if one == oval else np.nan,
        ),
    }
    cells = []
    for name, (what, value) in found.items():
        for one in measured(name):
            numbers = [value(own) for own in results.values() if POINTS[own.key].upright == one.upright]
            if numbers := [number for number in numbers if np.isfinite(number)]:
                low, high = min(numbers), max(numbers)
                cells.append((one.who, one.load, what, one.range, _from_to(low, high),
                              "yes" if low <= one.high and one.low <= high else "no"))  # fmt: skip
    head = ("who", "load", "what", "measured", "computed, all veins above", "do they meet")
    return (
        markdown_table(head, cells)
        + "\nNo number of the model was fitted to these. A leg that sits or stands has a vein of this shape while "
        "lying: it gets up before it is pressed, on the mesh of level `demo`, and its vein counts as closed at a tenth "
        "of the area that it then has.\n"
    )


TOUCHING = 0.3
"""Least det F of the blood's mesh from which on a vein counts as touching itself."""


def cost(closing: Mapping[str, StoredRun]) -> str:
    """Return what steps take while the vein touches itself, over those before, attempts that failed included."""
    rows = []
    for key, run in closing.items():
        touching = run.series["detF_min_fluid_1"][1:] < TOUCHING
        if touching.any() and not touching.all():
            means = [[float(np.mean(run.costs[name][part])) for part in (~touching, touching)]
                     for name in ("iterations", "factorisations", "wall_s")]  # fmt: skip
            steps = f"{np.sum(~touching)}, {np.sum(touching)}"
            title = POINTS[key.removesuffix("-closing")].title
            rows.append(
                (title, steps, *(f"{a:.1f}, {b:.1f}" for a, b in means[:2]), f"{means[2][1] / means[2][0]:.2f}")
            )
    head = ("vein, at rest under growing pressure", "steps before and in contact", "iterations", "factorisations",
            "seconds in contact over before")  # fmt: skip
    return markdown_table(head, rows) + f"\nIn contact: det F of the blood's mesh is below {TOUCHING:g} somewhere.\n"


def _from_to(low: float, high: float) -> str:
    """Return a range, or the number that it is, with two digits of what is below 1."""
    if low == high:
        return f"{low:.2g}" if low < 1 else f"{low:.0f}"
    return f"{low:.0f} to {high:.0f}"


def _draw(
    results: Mapping[str, Result], designed: Sequence[Designed], done: Mapping[str, StoredRun], folder: Path
) -> list[str]:
    """Draw the figures and return the lines of the report that show them."""
    found = []
    shapes = [key for key in ("round", "ratio_2", BASE, "ratio_4") if key in results]
    ratios = [POINTS[key].changes.get("geometry.aspect_ratio", RATIO) for key in shapes]
    span = [min(ratios), max(ratios)]
    others = [
        Line(f"{level:g} %, {one.load}", span, [level / 100] * 2, "--")
        for one in measured("loss_percent") for level in sorted({one.low, one.high})
    ]  # fmt: skip
    computed = [Line("computed", ratios, [results[key].loss_1 for key in shapes])]
    if designed:
        axes_of, losses = [one.ratio_1 for one in designed], [one.loss_1 for one in designed]
        computed.append(Line("all factors at once", axes_of, losses, "x"))
    panels = {"under 25 mmHg; dashed: measured": [*computed, *others]}
    lines(panels, (Shown("ratio of the axes", "1"), Shown("loss of area", "percent")), folder / "shape.png")
    found.append("![Loss of area over the ratio of the axes](shape.png)\n")
    curves = []
    for key in POINTS:
        if run := done.get(f"{key}-closing"):
            area = run.series["lumen_area_mean_m2"]
            curves.append(Line(POINTS[key].title, run.series["skin_pressure_mean_Pa"], area / area[0], "-"))
    if curves:
        axes = Shown("pressure on the skin", "mmHg"), Shown("area over that at rest", "1")
        lines({"steady flow from a source behind a resistance": curves}, axes, folder / "closing.png")
        found.append("![Area over the pressure on the skin](closing.png)\n")
    opened = [Line(POINTS[key].title, run.series["time_s"], run.series["lumen_area_mean_m2"]
                   / run.series["lumen_area_mean_m2"][0], "-")
              for key in POINTS if (run := done.get(f"{key}-reopening"))]  # fmt: skip
    if opened:
        axes = Shown("time", "s"), Shown("area over that at rest", "1")
        lines({"120 mmHg in 1 s, and none in another": opened}, axes, folder / "reopening.png")
        found.append("![Area over time while the vein is closed and let go](reopening.png)\n")
    if (film := done.get(f"{BASE}-reopening")) and not animation(film, folder / "reopening.gif"):
        found.append("![The oval vein, closed and let go, from its narrow side, with its wall shear](reopening.gif)\n")
    sections = [Group(POINTS[key].title, done[key]) for key in ("round", BASE) if key in done]
    if sections:
        outlines(sections, (0.0, 1.0), folder / "outlines.png")
        found.append("![Sections at mid-length before and after](outlines.png)\n")
    return found
