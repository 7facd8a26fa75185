"""What do the integration rules leave out? The calf's ramp with rules of higher and higher order on the same elements.

Held against the highest; beside the error that the elements themselves have, of which `discretisation` knows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ngfsi.case import Case
from ngfsi.errors import NgfsiError
from ngfsi.report.figures import Convergence, convergence
from ngfsi.report.tables import markdown_table
from ngfsi.store.stored import Columns, mean_over_steps
from ngfsi.study import Study, run_study, write_page
from ngfsi.units import Shown
from ngfsi_studies.discretisation import COLUMNS, Family, ramp

FAMILIES = {
    "demo": (Family("mixed", 3, (2.0,)),),
    "paper": (Family("mixed", 3, (2.0,)), Family("mixed", 2, (1.0,))),
}
"""By level: elements of one size, as in `discretisation`."""

EXTRA = (0, 2, 4, 6, 8)
"""Orders beyond the usual ones; the last is what the others are held against."""

TOLERANCE = 5e-8
"""Of Newton's method: rounding allows hardly less in the state at rest, whose flow is slow for its pressure."""

FIGURE = "integration.png"
TITLES = {"area": "largest change of the lumen's area", "sawss": "largest change of the SAWSS",
          "mean": "change of the SAWSS, mean over the ramp"}  # fmt: skip
WANTED = {"area": 1e-8, "sawss": 1e-6, "mean": 1e-6}
"""Changes that rules should not exceed to count as exact."""


def more(family: Family, extra: int) -> Case:
    """Return the ramp with integration rules of a higher order."""
    changes = {"discretisation.extra_integration_order": extra, "solver.tolerance": TOLERANCE}
    return ramp(family, family.sizes[0]).replace(**changes)


def changes_of(series: Columns, reference: Columns) -> dict[str, float]:
    """Return by how much area and SAWSS of a run are off those of another, relative, largest over the other's times."""
    times = reference["time_s"]
    area, sawss = (
        abs(np.interp(times, series["time_s"], series[name]) / reference[name] - 1)
        for name in ("lumen_volume_m3", "sawss_Pa")
    )
    mean = mean_over_steps(series, "sawss_Pa") / mean_over_steps(reference, "sawss_Pa") - 1
    return {"area": float(np.max(area)), "sawss": float(np.max(sawss)), "mean": float(abs(mean))}


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Run the comparison into a folder and return the path of the report.

    Raises:
        NgfsiError: a run failed.
    """
    families = FAMILIES.get(level, FAMILIES["paper"])
    cases = {_key(family, extra): more(family, extra) for family in families for extra in EXTRA}
    results = run_study(Study("runs", cases, COLUMNS), folder, quiet=quiet)
    series: dict[str, Columns] = {}
    for key, outcome in results.outcomes.items():
        if outcome.run is None or outcome.failure:
            raise NgfsiError(f"the run '{key}' failed: {outcome.failure}")
        series[key] = outcome.run.series
    found: dict[str, dict[str, float]] = {}
    lines: dict[str, list[Convergence]] = {name: [] for name in TITLES}
    for family in families:
        keys = [_key(family, extra) for extra in EXTRA]
        found |= {key: changes_of(series[key], series[keys[-1]]) for key in keys[:-1]}
        seconds = [results.table[key]["cpu_s"] for key in keys[:-1]]
        for name, drawn in lines.items():
            drawn.append(Convergence(family.title, seconds, [found[key][name] for key in keys[:-1]]))
    convergence({TITLES[name]: drawn for name, drawn in lines.items()}, folder / FIGURE,
                (Shown("CPU time of a run, one thread", "s"), Shown("relative change", "1")),
                {TITLES[name]: WANTED[name] for name in TITLES})  # fmt: skip
    return write_page(folder, "integration", level, _text(results.table, found))


def _key(family: Family, extra: int) -> str:
    return f"{family.title}, +{extra}"


def answer(table: Mapping[str, Mapping[str, float]], found: Mapping[str, Mapping[str, float]]) -> str:
    """Return a sentence that says what the usual rules leave out and what exact ones would cost."""
    usual = {key: changes for key, changes in found.items() if key.endswith(", +0")}
    first = next(iter(usual))
    same = [key for key in found if key.startswith(first.removesuffix("0"))]
    exact = [key for key in same if all(found[key][name] <= WANTED[name] for name in WANTED)]
    worst = {name: max(changes[name] for changes in usual.values()) for name in TITLES}
    said = (
        f"The usual rules leave out at most {worst['area']:.0e} of the area and {worst['sawss']:.0e} of the SAWSS at "
        "any time, a fraction of the error of the elements themselves (`ngfsi study discretisation`)"
    )
    if not exact:
        return f"{said}."
    cost = table[exact[0]]["cpu_s"] / table[first]["cpu_s"]
    return f"{said}; rules that count as exact take {cost:.1f} times as long ({exact[0]})."


def _text(table: Mapping[str, Mapping[str, float]], found: Mapping[str, Mapping[str, float]]) -> Sequence[str]:
    rows = [(key, f"{table[key]['cpu_s']:.1f}", *(f"{changes[name]:.1e}" for name in TITLES))
            for key, changes in found.items()]  # fmt: skip
    return (
        "# Integration orders for the calf\n",
        f"![changes over time]({FIGURE})\n",
        "M tissue under 25 mmHg in ten steps; `+n` are rules of an order n higher than the usual 2 k in the solids "
        f"and 2 k + 1 in the blood. Changes are distances from `+{EXTRA[-1]}`, relative, on the same elements; "
        "dotted: what would count as exact.\n",
        answer(table, found) + "\n",
        markdown_table(("elements and rules", "CPU (s)", *TITLES.values()), rows),
    )
