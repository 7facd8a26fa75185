"""Where does the blood of a deep vein stand still, and what moves it: a stocking, a pump, breathing?

The oval vein of `closing_vein` at rest, under a stocking, under intermittent compression, and with a flow that
breathing turns back (as in two of the source study's ten subjects); with blood of constant viscosity and blood that
thins. Of each the age of the blood, what is left of that of the start, and the wall's area of low shear. And a valve
that is held open, in whose pockets the blood stands.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import inf, isnan, pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from ngfsi_geometry.valve import ValvePocket
from numpy.typing import NDArray

from ngfsi.case import Case, Loads, Materials, TimeStepping
from ngfsi.config.functions import FlowConstant, FlowHarmonics, PressureConstant, PressureSmoothRamp, PressureTable
from ngfsi.materials import load_set
from ngfsi.report.tables import markdown_table
from ngfsi.report.terminal import console
from ngfsi.run.estimate import companions
from ngfsi.store.stored import StoredRun
from ngfsi.store.table import write_rows
from ngfsi.study import run_cases, write_page
from ngfsi.transport.models import Age, Exposure, Washout
from ngfsi.units import MMHG, Shown, in_unit
from ngfsi_studies import closing_vein, pneumatic
from ngfsi_studies.figures import TIME, Line, field_maps, lines, mid_plane

Array = NDArray[np.float64]

PERIOD = 6.0
"""Of breathing (s), as in the source study."""
REVERSING = 1.5
"""Amplitude of the flow over its mean, where breathing turns it back."""
STOCKING = 18 * MMHG
"""Of a stocking of grade 1 at the knee (Pa)."""
PUMP = 40 * MMHG
INFLATED = (0.0, 2.0, 4.0, 8.0)
"""When a cycle of intermittent compression begins to press, is at its full pressure, lets go and is empty (s)."""
CYCLE = 2 * PERIOD
REST = "rest_constant"
"""The run whose companions tell the errors."""
SCALARS = (Age(), Washout(washed_out=0.9), Exposure())
REYNOLDS = (5.0, 100.0)
"""Of the flow through the valve: a vein of a leg that rests, and one that is pumped."""


class Condition(NamedTuple):
    """What acts on the vein: a title, the pressure on the skin, whether breathing drives its flow or the pressure
    upstream does, and by how much its steps are shorter."""

    title: str
    pressure: Any
    breathing: bool = False
    finer: int = 1


def _pump() -> Any:
    start, full, held, empty = INFLATED
    starts = (0.0, CYCLE)
    times = [t + s for s in starts for t in (start, full, held, empty)]
    return PressureTable(times=tuple(times), values=(0.0, PUMP, PUMP, 0.0) * len(starts))


CONDITIONS = {
    "rest": Condition("at rest", PressureConstant(value=0.0)),
    "stocking": Condition("stocking, 18 mmHg", PressureSmoothRamp(final=STOCKING, duration=2.0)),
    "pump": Condition("pump, 40 mmHg for 2 s", _pump(), finer=2),
    "breathing": Condition("breathing that turns the flow back", PressureConstant(value=0.0), breathing=True),
}
BLOODS = {"constant": ("blood", "constant viscosity"), "thinning": ("blood_carreau", "thins under shear")}
"""Key -> parameter set, and what it is called."""


class Level(NamedTuple):
    """How finely to compute: level of `closing_vein` whose mesh is taken, step and end (s), which conditions with blood
    that thins; sizes of the valve's elements (m), and how many times of transit are followed in it."""

    mesh: str
    step: float
    end: float
    thinning: tuple[str, ...]
    leaflet_size: float
    transits: float


LEVELS = {
    "demo": Level("demo", 0.2, CYCLE, ("rest",), 1.6e-3, 1.5),
    "paper": Level("paper", 0.1, 2 * CYCLE, tuple(CONDITIONS), 1.1e-3, 10.0),
}


def case(key: str, blood: str, level: Level) -> Case:
    """Return the vein in a condition."""
    base, condition = closing_vein.case(closing_vein.BASE, closing_vein.LEVELS[level.mesh]), CONDITIONS[key]
    flow = base.loads.inlet_flow(0.0)
    step = level.step / condition.finer
    openings = {} if condition.breathing else {"inlet": pneumatic.source(base)}
    breathing = FlowHarmonics(mean=flow, amplitudes=(REVERSING * flow,), phases=(-pi / 2,), period=PERIOD)
    return base.replace(**{
        "name": f"{key}-{blood}", "loads.skin_pressure": condition.pressure, "loads.openings": openings,
        "loads.inlet_flow": breathing if condition.breathing else FlowConstant(value=flow),
        "materials.fluid": load_set(BLOODS[blood][0]), "scalars": SCALARS,
        "time.step": step, "time.smallest_step": step / 256, "time.end": level.end,
        "output.fields_every": 0,
    })  # fmt: skip


def valve_case(reynolds: float, level: Level) -> Case:
    """Return steady flow through a valve that is held open."""
    valve = ValvePocket(upstream=6e-3, downstream=10e-3, leaflet_size=level.leaflet_size)
    blood: Any = load_set("blood")
    mean = reynolds * blood.nominal_viscosity / (blood.density * 2 * valve.radius)
    transit = valve.exact_volumes()["fluid"] / (mean * pi * valve.radius**2)
    return Case(
        name=f"valve-{reynolds:g}", geometry=valve, materials=Materials(fluid=blood),
        scalars=(Age(), Washout(name="pocket", corners=valve.pocket())),
        loads=Loads(inlet_flow=FlowConstant(value=mean * pi * valve.radius**2)),
        time=TimeStepping(step=transit / 10, end=level.transits * transit, scheme="static"),
    ).replace(**{"output.fields_every": 0})  # fmt: skip


def over(run: StoredRun, column: str, span: float) -> float:
    """Return the mean of a column over the last time (s) of a run."""
    times, values = run.series["time_s"], run.series[column]
    last = times >= times[-1] - span - 1e-9
    return float(np.trapezoid(values[last], times[last]) / np.ptp(times[last]))


COLUMNS: dict[str, Callable[[StoredRun], float]] = {
    "age_s": lambda run: over(run, "age_mean_s", PERIOD),
    "oldest_outflow_s": lambda run: float(np.nanmax(run.series["age_outlet_s"])),
    "left_1": lambda run: float(run.series["washout_left_1"][-1]),
    "washout_s": lambda run: float(run.series["washout_time_s"][-1]),
    "low_shear_1": lambda run: over(run, "wss_low_area_1", CYCLE),
    "sawss_Pa": lambda run: over(run, "sawss_Pa", CYCLE),
    "exposure_1": lambda run: float(run.series["exposure_mean_1"][-1]),
}
"""Of each run: mean age of the blood over the last breath; largest mean age of what leaves; part of the blood of the
start that is left; when 90 % of it had left; area of low wall shear (below 0.1 Pa) and SAWSS, means over the last
cycle; mean exposure of platelets tau t^0.452 in the end."""
SHOWN = {
    "age_s": ("mean age", "s"), "oldest_outflow_s": ("oldest outflow", "s"),
    "left_1": ("blood of the start", "percent"), "washout_s": ("90 % of it gone at", "s"),
    "low_shear_1": ("wall below 0.1 Pa", "percent"), "sawss_Pa": ("SAWSS", "Pa"),
    "exposure_1": ("exposure Pa s^0.452", "1"),
}  # fmt: skip


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Run the study at a level into a folder and return the path of the report."""
    chosen = LEVELS[level]
    wanted = [(key, "constant") for key in CONDITIONS] + [(key, "thinning") for key in chosen.thinning]
    cases = {f"{key}_{blood}": case(key, blood, chosen) for key, blood in wanted}
    judged = {f"{REST}-{error}": one for error, one in companions(cases[REST]).items()}
    valves = {f"valve_{reynolds:g}": valve_case(reynolds, chosen) for reynolds in REYNOLDS}
    outcomes = run_cases(cases | judged | valves, folder, quiet=quiet)
    done = {key: one.run for key, one in outcomes.items() if one.run is not None and not one.failure}
    veins = {key: run for key, run in done.items() if key in cases}
    results = {key: {name: of(run) for name, of in COLUMNS.items()} for key, run in veins.items()}
    errors = errors_of(results.get(REST, {}), [{name: of(done[key]) for name, of in COLUMNS.items()}
                                               for key in judged if key in done])  # fmt: skip
    write_rows(folder / "results.csv", [{"run": key, **row} for key, row in results.items()])
    pockets = {key: in_pockets(done[key]) for key in valves if key in done}
    write_rows(folder / "pockets.csv", [{"run": key, **row} for key, row in pockets.items()])
    parts = [
        f"# Where the blood stands still, level `{level}`\n", answer(results, pockets), *_draw(veins, folder),
        "## The vein\n", table(results, errors),
        "The vein of study `closing_vein`, 3.2 : 1 in M tissue, blood at 10 mmHg, 2.913 ml/s at rest from a pressure "
        "behind resistance, compliance and valve, as in `pneumatic`. Age counts from the start of the run where the "
        f"blood has not entered since, so that it is at most {chosen.end:g} s. Breathing: a given flow of the same "
        f"mean and {REVERSING:g} times that as amplitude, period {PERIOD:g} s; what it takes back through the inlet "
        "comes in again, so much older. The mean age is one over the last 6 s, low shear and SAWSS are over the last "
        "12 s.\n",
        "±: the sum of the differences of the run at rest to runs of one order more or less and of twice the step "
        "(`ngfsi run --error`), in proportion for the others, too. A part of the wall of 100 % tells no error, and "
        "that of others is not known.\n",
        "## Behind the leaflets of a valve\n", *_draw_pockets({key: done[key] for key in pockets}, folder),
        pocket_table(pockets),
        "Rigid, steady flow; leaflets open by 55 % of the diameter; no error is estimated. What is marked lies behind "
        "the outer half of one leaflet. Karino and Motomiya (1984) saw a vortex behind the edge of each leaflet and a "
        "second one deeper in the pocket, so slow that cells gather there; the test of the geometry finds both "
        "(tests/geometry/test_valve.py).\n",
    ]  # fmt: skip
    path = write_page(folder, "stasis", level, parts, outcomes)
    if not quiet:
        console().print(answer(results, pockets))
    return path


def in_pockets(run: StoredRun) -> dict[str, float]:
    """Return how many mean times of transit were followed, and of the blood that was behind a leaflet at the start what
    is left after one of them and in the end; the transit (s)."""
    series = run.series
    transit = float(series["lumen_volume_m3"][0] / series["flow_in_m3_s"][0])
    times, left = series["time_s"] / transit, series["pocket_left_1"]
    return {"transit_s": transit, "transits_1": float(times[-1]),
            "left_after_one_1": float(np.interp(1.0, times, left)), "left_1": float(left[-1])}  # fmt: skip


def answer(results: dict[str, dict[str, float]], pockets: dict[str, dict[str, float]]) -> str:
    """Return what matters, in sentences."""
    said = []
    if rest := results.get("rest_constant"):
        for key in ("stocking", "pump", "breathing"):
            if one := results.get(f"{key}_constant"):
                age, left = (f"{in_unit(one[name], unit, '.3g')} against {in_unit(rest[name], unit, '.3g')} at rest"
                             for name, unit in (("age_s", "s"), ("left_1", "percent")))  # fmt: skip
                said.append(f"- {CONDITIONS[key].title}: mean age {age}, blood of the start that is left {left}.")
        if thin := results.get("rest_thinning"):
            low = (in_unit(of["low_shear_1"], "percent", ".3g") for of in (thin, rest))
            said.append(f"- Blood that thins has at rest {' against '.join(low)} of the wall below 0.1 Pa, and a mean "
                        f"age of {in_unit(thin['age_s'], 's', '.3g')}.")  # fmt: skip
    for key, one in pockets.items():
        said.append(f"- Behind a leaflet at Reynolds number {key.removeprefix('valve_')}: after "
                    f"{in_unit(one['transit_s'], 's', '.3g')}, in which the vein's volume flows through once, "
                    f"{in_unit(one['left_after_one_1'], 'percent', '.4g')} of the blood is still there.")  # fmt: skip
    return "\n".join(said or ["All runs failed."]) + "\n"


def errors_of(rest: Mapping[str, float], others: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the relative errors of what is read of the run at rest: sums of the differences to its companions."""
    found = {name: sum(abs(other[name] / value - 1) for other in others) for name, value in rest.items()}
    return {name: error for name, error in found.items() if 0 < error < inf}


def table(results: dict[str, dict[str, float]], errors: Mapping[str, float]) -> str:
    """Return all runs of the vein, with relative errors by what is shown."""
    shown = {name: Shown(*of) for name, of in SHOWN.items()}
    cells = [(*_titles(key), *(_cell(of(row[name]), errors.get(name, 0.0)) for name, of in shown.items()))
             for key, row in results.items()]  # fmt: skip
    return markdown_table(("condition", "blood", *(of.label for of in shown.values())), cells)


def _cell(value: float, error: float) -> str:
    """Return a number with its error, if that is known; nothing for what there is not."""
    if isnan(value):
        return ""
    return closing_vein.with_error(value, value * error) if error else f"{value:.3g}"


def _titles(key: str) -> tuple[str, str]:
    condition, blood = key.rsplit("_", 1)
    return CONDITIONS[condition].title, BLOODS[blood][1]


def pocket_table(pockets: dict[str, dict[str, float]]) -> str:
    """Return the valves."""
    cells = [(key.removeprefix("valve_"), *(f"{value:.4g}" for value in (
        one["transit_s"], 100 * one["left_after_one_1"], one["transits_1"], 100 * one["left_1"])))
        for key, one in pockets.items()]  # fmt: skip
    return markdown_table(("Reynolds number", "mean transit [s]", "left in the pocket after one [%]", "transits",
                           "left after them [%]"), cells)  # fmt: skip


CURVES = {
    "age_mean_s": ("mean age", "s"), "washout_left_1": ("blood of the start that is left", "percent"),
    "wss_low_area_1": ("part of the wall below 0.1 Pa", "percent"),
}  # fmt: skip


def _draw(veins: dict[str, StoredRun], folder: Path) -> list[str]:
    """Draw the courses in time and return the lines of the report that show them."""
    found = []
    for column, (name, unit) in CURVES.items() if veins else ():
        drawn = [Line(key.removesuffix("_constant").replace("_", ", "), run.series["time_s"], run.series[column], "-")
                 for key, run in veins.items()]  # fmt: skip
        file = f"{column.rsplit('_', 1)[0]}.png"
        lines({name: drawn}, (TIME, Shown(name, unit)), folder / file)
        found.append(f"![{name}]({file})\n")
    return found


def _draw_pockets(valves: dict[str, StoredRun], folder: Path) -> list[str]:
    """Draw the age between the leaflets and return the lines of the report that show it."""
    if not valves:
        return []
    panels = {f"Reynolds number {key.removeprefix('valve_')}":
              mid_plane(run, "age_s", 1 / in_pockets(run)["transit_s"]) for key, run in valves.items()}  # fmt: skip
    field_maps(panels, Shown("age over the mean transit", "1"), folder / "pockets.png", limits=(0.0, 1.5),
               axes=(Shown("z, along the vein", "mm"), Shown("y", "mm")))  # fmt: skip
    return ["![Age of the blood in the plane through both leaflets](pockets.png)\n"]
