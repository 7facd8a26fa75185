"""What decides how far a vein closes under 25 mmHg, and how its wall shear stress rises?

Morris's elementary effects of eleven properties of tissue, wall, vein, blood and model on three results of the calf
run with Mooney-Rivlin tissue, each over the range in which it is known.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ngfsi.case import Case
from ngfsi.errors import NgfsiError
from ngfsi.report.tables import markdown_table
from ngfsi.report.terminal import console
from ngfsi.store.stored import StoredRun
from ngfsi.store.table import write_rows
from ngfsi.study import Results, Study, run_study, write_page
from ngfsi.study.design import STEP, Design, Indices, indices, morris, whole_trajectories
from ngfsi_studies import compare_tissues
from ngfsi_studies.figures import Effects, elementary_effects
from ngfsi_studies.source import tables
from ngfsi_studies.tissue_findings import SWING, mean_sawss

SEED = 7
SHOWN = {"s": "ml/s"}
"""Last part of a name -> unit, where they differ."""
SMALL = 0.15
"""Effects below this fraction of the largest are not named one by one."""


@dataclass(frozen=True)
class Factor:
    """One thing that is varied.

    Attributes:
        name: with its unit, as in the tables.
        title: for figures and sentences.
        low, high: of its range, in the unit.
        keys: keys of the case file that take the value.
        source: why this range.
        relative: whether the value multiplies what the keys have in the base.
        options: the value below the middle of the range, and above, where it is a choice.
    """

    name: str
    title: str
    low: float
    high: float
    keys: tuple[str, ...]
    source: str
    relative: bool = False
    options: tuple[str, str] | None = None

    def changes(self, base: Case, value: float) -> dict[str, Any]:
        """Return the changes of a case that give the factor a value."""
        if self.options:
            return dict.fromkeys(self.keys, self.options[value > (self.low + self.high) / 2])
        if self.relative:
            present: dict[str, Any] = {key: reduce(getattr, key.split("."), base) for key in self.keys}
            return {key: value * known for key, known in present.items()}
        return dict.fromkeys(self.keys, value)

    @property
    def span(self) -> str:
        """The range, in words."""
        if self.options:
            return " or ".join(self.options)
        unit = "" if self.name.endswith("_1") else self.name.partition("_")[2].rpartition("_")[2]
        return f"{self.low:g} to {self.high:g} {SHOWN.get(unit, unit)}".rstrip()


TISSUE = "materials.tissue."
BULK = tables("calibration")["bulk_modulus_kPa"]
FACTORS: tuple[Factor, ...] = (
    Factor("tissue_K_kPa", "bulk modulus of the tissue", min(BULK), max(BULK), (TISSUE + "K_kPa",),
           "the source's subjects"),
    Factor("tissue_stiffness_1", "shear stiffness of the tissue", 0.7, 1.3,
           (TISSUE + "c10", TISSUE + "c01", TISSUE + "c11"), "factor on the constants of the law", relative=True),
    Factor("wall_young_kPa", "Young's modulus of the wall", 93, 173, ("materials.wall.young_kPa",), "133 kPa +- 30 %"),
    Factor("wall_thickness_mm", "thickness of the wall", 0.7, 1.3, ("geometry.wall_thickness_mm",), "1 mm +- 30 %"),
    Factor("vein_x_mm", "lateral position of the vein", 2, 8, ("geometry.vein_x_mm",), "from mid-calf to the fibula"),
    Factor("vein_y_mm", "anterior position of the vein", -12, -6, ("geometry.vein_y_mm",), "deep posterior muscles"),
    Factor("lumen_mm", "diameter of the lumen", 8, 11.1, ("geometry.lumen_diameter_mm",), "the source's two models"),
    Factor("flow_ml_s", "inflow Q", 2, 4, ("loads.inlet_flow.value_ml_s",),
           "2.9 ml/s, about +- 1/3; inferred, the source prints none"),
    Factor("outlet_mmHg", "outlet pressure", 5, 15, ("loads.outlet_pressure.value_mmHg",), "10 mmHg +- 5: posture"),
    Factor("ends_1", "ends of the segment", 0, 1, ("conditions.ends",), "choice of the model",
           options=("roller", "clamped")),
    Factor("state_1", "state at t = 0", 0, 1, ("conditions.initial_state",), "choice of the model",
           options=("preload", "prestress")),
)  # fmt: skip


def _loss(run: StoredRun) -> float:
    volume = run.series["lumen_volume_m3"]
    return 100 * (1 - float(volume[run.loaded_row] / volume[0]))


def _sawss(run: StoredRun) -> float:
    return mean_sawss(run, float(run.series["time_s"][run.loaded_row]))


def _rise(run: StoredRun) -> float:
    return 100 * (_sawss(run) / float(run.series["sawss_Pa"][0]) - 1)


class Result(NamedTuple):
    """What is asked of each run: title, unit in sentences, number of a run."""

    title: str
    unit: str
    of: Callable[[StoredRun], float]


RESULTS = {
    "area_loss_percent": Result("loss of area", "percentage points", _loss),
    "sawss_Pa": Result("SAWSS", "Pa", _sawss),
    "sawss_rise_percent": Result("rise of SAWSS", "percentage points", _rise),
}


class Level(NamedTuple):
    """How finely to compute: the runs, those that tell their error, and the number of trajectories."""

    runs: compare_tissues.Level
    reference: compare_tissues.Level
    trajectories: int


LEVELS = {
    "demo": Level(compare_tissues.COARSE, compare_tissues.LEVELS["demo"], 10),
    "paper": Level(compare_tissues.LEVELS["demo"], compare_tissues.LEVELS["paper"]._replace(end=1.0), 20),
    "fine": Level(compare_tissues.LEVELS["paper"]._replace(end=1.0), compare_tissues.LEVELS["fine"], 40),
}


def base_case(level: compare_tissues.Level) -> Case:
    """Return the run that is varied, with nothing written on the way."""
    quiet = {"output.fields_every": 0, "output.wall_every": 1000, "output.checkpoint_every": 0}
    return compare_tissues.case(compare_tissues.MAIN[0], level).replace(**quiet)


def varied(base: Case, point: Mapping[str, float]) -> Case:
    """Return the case in which the factors named have these values."""
    changes: dict[str, Any] = {}
    for factor in FACTORS:
        if factor.name in point:
            changes |= factor.changes(base, point[factor.name])
    return base.replace(**changes)


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Compute the effects at a level into a folder and return the path of the report.

    Raises:
        NgfsiError: fewer than two trajectories of the design came to their end.
    """
    chosen = LEVELS[level]
    design = morris({factor.name: (factor.low, factor.high) for factor in FACTORS}, chosen.trajectories, SEED)
    inputs = design.values()
    base = base_case(chosen.runs)
    cases = {key: varied(base, point) for key, point in inputs.items()}
    columns = {name: result.of for name, result in RESULTS.items()}
    results = run_study(Study("runs", cases, columns, inputs), folder, quiet=quiet)
    found = {name: _indices(design, results, name) for name in RESULTS}
    errors = _errors(chosen, inputs, results, folder, quiet)
    outside = _outside(base, folder, quiet)
    write_rows(folder / "effects.csv", _rows(found))
    elementary_effects({f"{r.title} [{_axis(r.unit)}]": _effects(found[name]) for name, r in RESULTS.items()},
                       folder / "effects.png")  # fmt: skip
    path = write_page(folder, "sensitivity", level, _text(level, design, results, found, errors, outside))
    if not quiet:
        console().print("\n".join(answer(RESULTS[name], found[name]) for name in RESULTS))
    return path


def _indices(design: Design, results: Results, name: str) -> Indices:
    values = [results.table.get(key, {}).get(name, np.nan) for key in results.outcomes]
    kept, finite = whole_trajectories(design, values)
    if len(kept.points) < 2 * (len(design.factors) + 1):
        failures = {outcome.failure for outcome in results.outcomes.values() if outcome.failure}
        raise NgfsiError(f"fewer than two trajectories came to their end: {'; '.join(sorted(failures))}")
    return _of_choices(indices(kept, finite, SEED))


def _of_choices(found: Indices) -> Indices:
    """Return the effects with those of choices as the difference that the choice makes.

    A step of part of the range changes a choice altogether, so that there is nothing to extrapolate to the whole range.
    """
    fraction = np.array([STEP if factor.options else 1.0 for factor in FACTORS])
    names = ("first", "first_half_width", "second", "second_half_width")
    return replace(found, **{name: fraction * getattr(found, name) for name in names})


class Error(NamedTuple):
    """One case on both discretisations: what it is, and result -> (as in the study, with the reference)."""

    title: str
    values: Mapping[str, tuple[float, float]]


def _errors(
    level: Level, inputs: Mapping[str, Mapping[str, float]], results: Results, folder: Path, quiet: bool
) -> list[Error]:
    """Compute the base and the cases of smallest and largest loss with the finer reference, too."""
    by_loss = sorted(results.table, key=lambda key: results.table[key]["area_loss_percent"])
    chosen = {"base": {}, "smallest loss": inputs[by_loss[0]], "largest loss": inputs[by_loss[-1]]}
    cases = {
        f"{title}, {which}": varied(base_case(discretisation), point)
        for title, point in chosen.items()
        for which, discretisation in (("study", level.runs), ("reference", level.reference))
    }
    found = run_study(Study("errors", cases, {name: r.of for name, r in RESULTS.items()}), folder, quiet=quiet).table
    return [
        Error(title, {name: (found[f"{title}, study"][name], found[f"{title}, reference"][name]) for name in RESULTS})
        for title in chosen
        if f"{title}, study" in found and f"{title}, reference" in found
    ]


def _outside(base: Case, folder: Path, quiet: bool) -> str:
    """Compute the base with the bulk moduli that are quoted elsewhere, and return what they change."""
    (bulk,) = (factor for factor in FACTORS if factor.name == "tissue_K_kPa")
    quoted = tables("calibration")["bulk_modulus_elsewhere_kPa"].values()
    known = {"base": {}, **{f"K {value:g} kPa": {bulk.name: float(value)} for value in quoted}}
    cases = {title: varied(base, point) for title, point in known.items()}
    columns = {name: result.of for name, result in RESULTS.items()}
    found = run_study(Study("outside", cases, columns, known), folder, quiet=quiet).table
    heads = [f"{result.title} [{_axis(result.unit)}]" for result in RESULTS.values()]
    return markdown_table(
        ("case", *heads), [(title, *(f"{row[name]:.4g}" for name in RESULTS)) for title, row in found.items()]
    )


def _rows(found: Mapping[str, Indices]) -> list[dict[str, float | str]]:
    return [
        {
            "result": name, "factor": factor.name, "low": factor.low, "high": factor.high,
            "mu_star": float(i.first[n]), "mu_star_half_width": float(i.first_half_width[n]),
            "sigma": float(i.second[n]),
        }
        for name, i in found.items()
        for n, factor in enumerate(FACTORS)
    ]  # fmt: skip


def _axis(unit: str) -> str:
    return "%" if unit == "percentage points" else unit


def _effects(found: Indices) -> Effects:
    return Effects([factor.title for factor in FACTORS], found.first, found.first_half_width, found.second)


def answer(result: Result, found: Indices) -> str:
    """Return the sentence that says what matters most for a result."""
    order = np.argsort(-found.first)
    first = order[0]

    def told(n: int) -> str:
        return f"{FACTORS[n].title} ({found.first[n]:.3g} ± {found.first_half_width[n]:.2g})"

    lowest = found.first[first] - found.first_half_width[first]
    level = [n for n in order[1:] if found.first[n] + found.first_half_width[n] >= lowest]
    named = [n for n in order[1:] if n not in level and found.first[n] >= SMALL * found.first[first]]
    rest = [n for n in order[1:] if n not in level and n not in named]
    text = f"**The {result.title}** hangs most on the {told(first)}"
    text += f", not told apart from the {_listed([told(n) for n in level])}" if level else ""
    text += f"; then on the {_listed([told(n) for n in named])}" if named else ""
    if rest:
        text += f"; at most {max(found.first[n] for n in rest):.2g} each on the "
        text += _listed([FACTORS[n].title for n in rest])
    return f"{text}. Mean absolute effects over the whole range, in {result.unit}."


def _listed(words: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def _text(
    level: str, design: Design, results: Results, found: Mapping[str, Indices], errors: Sequence[Error], outside: str
) -> Sequence[str]:  # fmt: skip
    number = len(design.points) // (len(FACTORS) + 1)
    return (
        f"# What decides the compression of a deep vein, level `{level}`\n",
        *(f"- {answer(RESULTS[name], i)}" for name, i in found.items()),
        f"\n{len(results.table)} of {len(results.outcomes)} runs, {number} trajectories through {len(FACTORS)} "
        "factors (Morris 1991): a step along one factor changes the result by an elementary effect; mu* is the "
        "mean of its absolute value, for a step over the whole range or from one choice to the other, with the "
        "95 % confidence of a bootstrap over the trajectories; sigma is its standard deviation: a factor whose "
        "sigma is near its mu* acts nonlinearly or through others. Results are those at the end of the ramp to "
        f"25 mmHg within 1 s, loss and rise against t = 0; SAWSS is the mean of the last {SWING:g} s.\n",
        "![mu* with confidence, and sigma over mu*](effects.png)\n",
        _table(found),
        "## Ranges\n",
        markdown_table(
            ("factor", "range", "why"), [(f.title, f.span, f.source) for f in FACTORS]
        ),
        "The effects are those of these ranges: half of the range of a factor that acts linearly has half of the "
        "effect.\n",
        "## Bulk moduli outside of the range\n",
        "What is said above of the bulk modulus holds within the range of the source's subjects. For another "
        "group's work larger ones are quoted, with which the base gives\n",
        outside,
        "## How wrong are these runs?\n",
        _error_table(errors),
        "Every run of the study has the coarse mesh and steps in the columns `study`; `reference` is the next "
        "finer level of `compare_tissues`. An error that all runs share drops out of the effects.\n",
        "All runs: [runs.csv](runs.csv), [runs.md](runs.md). Effects: [effects.csv](effects.csv).\n",
    )  # fmt: skip


def _table(found: Mapping[str, Indices]) -> str:
    head = ["factor"]
    for name in found:
        head += [f"{RESULTS[name].title}: mu* [{_axis(RESULTS[name].unit)}]", "sigma"]
    rows = []
    for n in np.argsort(-next(iter(found.values())).first):
        cells = [FACTORS[n].title]
        for i in found.values():
            cells += [f"{i.first[n]:.3g} ± {i.first_half_width[n]:.2g}", f"{i.second[n]:.2g}"]
        rows.append(cells)
    return markdown_table(head, rows)


def _error_table(errors: Sequence[Error]) -> str:
    head = ["case"]
    for result in RESULTS.values():
        head += [f"{result.title} [{_axis(result.unit)}]: study", "reference", "difference"]
    rows = []
    for error in errors:
        cells = [error.title]
        for name, (study_value, reference) in error.values.items():
            difference = study_value - reference
            change = f"{difference:+.2g}" if RESULTS[name].unit != "Pa" else f"{100 * difference / reference:+.1f} %"
            cells += [f"{study_value:.4g}", f"{reference:.4g}", change]
        rows.append(cells)
    return markdown_table(head, rows)
