"""Numerical errors of the levels of compare_tissues.py, measured by refinement, with Richardson's error bars.

    python -m ngfsi_studies.tissue_accuracy FOLDER

Space and time are refined one at a time, for M with K 28.45 kPa: three meshes with the scheme and step of `demo`, and
on the mesh of `demo` also three steps of the scheme of `paper`; a run of one order more on that mesh checks the space.
The error of a level is its distance from the finest run, plus that run's own error bar, and those of space and time are
added. They are kept in accuracy.toml beside this module, and all runs in docs/accuracy.md. Runs in the folder that are
finished are reused.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from math import log2
from pathlib import Path

import tomli_w

from ngfsi.errors import NgfsiError
from ngfsi.report.tables import markdown_table
from ngfsi.store.stored import StoredRun
from ngfsi.study import run_cases
from ngfsi_studies.compare_tissues import LEVELS, MAIN, case
from ngfsi_studies.tissue_findings import ACCURACY, mean_sawss

DEMO, PAPER, FINE = (LEVELS[name] for name in ("demo", "paper", "fine"))
RUNS = {
    "demo_mesh": DEMO,
    "paper_mesh": DEMO._replace(mesh=PAPER.mesh),
    "fine_mesh": DEMO._replace(mesh=FINE.mesh),
    "order_more": DEMO._replace(order=DEMO.order + 1, mesh=DEMO.mesh.replace(curving_order=DEMO.order + 1)),
    "double_step": PAPER._replace(mesh=DEMO.mesh, end=DEMO.end, step=2 * PAPER.step),
    "paper_step": PAPER._replace(mesh=DEMO.mesh, end=DEMO.end),
    "half_step": PAPER._replace(mesh=DEMO.mesh, end=DEMO.end, step=PAPER.step / 2),
}
SPACE, TIME = ("demo_mesh", "paper_mesh", "fine_mesh"), ("double_step", "paper_step", "half_step")
"""Runs from coarse to fine."""
LEVEL_RUNS = {
    "demo": {"space": "demo_mesh", "time": "demo_mesh"},
    "paper": {"space": "paper_mesh", "time": "paper_step"},
}
"""Level -> what is refined -> the run with its mesh or step."""
PAGE = Path(__file__).parents[2] / "docs" / "accuracy.md"
ORDER_IN_SPACE = 2.0
"""Assumed for the error bars, on the safe side: smooth displacements converge with order 4 here, wall shear with 3."""
SLOWEST, FASTEST = 1.0, 2.0
"""Range of the observed order in time; beyond it the steps are too coarse to tell."""

Results = dict[str, float]


def measure(folder: Path, target: Path = ACCURACY, page: Path = PAGE) -> dict[str, dict[str, float]]:
    """Compute the runs, write the errors of the levels [%] and the table of runs, and return the errors.

    Raises:
        NgfsiError: a run failed.
    """
    outcomes = run_cases({key: case(MAIN[0], level) for key, level in RUNS.items()}, folder)
    runs: dict[str, StoredRun] = {}
    for key, outcome in outcomes.items():
        if outcome.run is None or outcome.failure:
            raise NgfsiError(f"the run '{key}' in '{folder}' failed: {outcome.failure}")
        runs[key] = outcome.run
    found = {key: _at_ramp_end(run) for key, run in runs.items()}
    bars = {"space": _bar_of_space(runs, found), "time": _bar_of_time(found)}
    finest = {"space": found[SPACE[-1]], "time": found[TIME[-1]]}
    errors = {
        level: _sum({what: _error(found[key], finest[what], bars[what]) for what, key in of.items()})
        for level, of in LEVEL_RUNS.items()
    }
    target.write_text(tomli_w.dumps(errors), encoding="utf-8")
    page.write_text(_table(runs, found, bars), encoding="utf-8")
    return errors


def _bar_of_space(runs: Mapping[str, StoredRun], found: Mapping[str, Results]) -> Results:
    """Return the error of the finest mesh, estimated from the mesh before it (Richardson)."""
    before, last = SPACE[-2:]
    ratio = (runs[last].manifest["unknowns"] / runs[before].manifest["unknowns"]) ** (1 / 3)
    return {name: abs(found[before][name] - value) / (ratio**ORDER_IN_SPACE - 1) for name, value in found[last].items()}


def _bar_of_time(found: Mapping[str, Results]) -> Results:
    """Return the error of the shortest step, estimated with the order observed in the last three (Richardson)."""
    bars = {}
    for name in found[TIME[-1]]:
        first, second, third = (found[key][name] for key in TIME)
        order = log2(abs(first - second) / abs(second - third)) if second != third and first != second else SLOWEST
        bars[name] = abs(second - third) / (2 ** min(max(order, SLOWEST), FASTEST) - 1)
    return bars


def _error(coarse: Results, finest: Results, bar: Results) -> Results:
    """Return by how many percent results may be wrong: their distance from the finest, and its own error bar."""
    return {name: 100 * (abs(value - finest[name]) + bar[name]) / abs(finest[name]) for name, value in coarse.items()}


def _at_ramp_end(run: StoredRun) -> Results:
    row = run.loaded_row
    names = "time_s", "lumen_volume_m3", "sawss_Pa", "wss_max_Pa"
    time, volume, sawss, largest = (float(run.series[column][row]) for column in names)
    loss = 1 - volume / float(run.series["lumen_volume_m3"][0])
    return {"volume": volume, "loss": loss, "sawss": sawss, "mean_sawss": mean_sawss(run, time), "largest_wss": largest}


def _sum(parts: Mapping[str, Results]) -> Results:
    """Return each error and its parts, to two digits."""
    names = next(iter(parts.values()))
    errors = {f"{name}_percent": sum(part[name] for part in parts.values()) for name in names}
    errors |= {f"{name}_{what}_percent": part[name] for what, part in parts.items() for name in names}
    return {name: float(f"{error:.2g}") for name, error in errors.items()}


def _table(runs: Mapping[str, StoredRun], found: Mapping[str, Results], bars: Mapping[str, Results]) -> str:
    """Return the page with all runs and the error bars of the finest ones."""
    head = ("run", "order", "unknowns", "scheme", "step (ms)", "mean area (mm2)", "loss (%)", "SAWSS (Pa)",
            "SAWSS, mean of 0.4 s (Pa)", "largest wall shear (Pa)")  # fmt: skip
    rows = []
    for key, run in runs.items():
        area = 1e6 / run.case.geometry.length
        shears = (f"{found[key][name]:.5f}" for name in ("sawss", "mean_sawss", "largest_wss"))
        time = run.case.time
        about = (
            str(run.case.discretisation.order),
            f"{run.manifest['unknowns']:,}",
            time.scheme,
            f"{1e3 * time.step:g}",
        )
        rows.append((key.replace("_", " "), *about, f"{area * found[key]['volume']:.3f}",
                     f"{100 * found[key]['loss']:.3f}", *shears))  # fmt: skip
    for what, key in (("space", SPACE[-1]), ("time", TIME[-1])):
        fractions = [f"{100 * bars[what][name] / abs(found[key][name]):.2g} %" for name in found[key]]
        rows.append((f"error bar of {key.replace('_', ' ')}, {what}", "", "", "", "", *fractions))
    return (
        "# Numerical error of the calf\n\n"
        "M tissue with K 28.45 kPa at the end of the ramp of 25 mmHg in 1 s, computed with\n"
        "`python -m ngfsi_studies.tissue_accuracy FOLDER`. Meshes, schemes and steps are those of `compare_tissues`,\n"
        "refined one at a time; `order more` is the mesh of `demo` with elements of one order more. Error bars are\n"
        f"Richardson's: of the finest mesh with order {ORDER_IN_SPACE:g} in the size of its elements, of the shortest\n"
        f"step with the order seen in the three shortest, between {SLOWEST:g} and {FASTEST:g}. The errors of the\n"
        "levels, in [accuracy.toml](../studies/ngfsi_studies/accuracy.toml), are the distance from the finest run\n"
        "plus its error bar, those of space and time added.\n\n" + markdown_table(head, rows)
    )


if __name__ == "__main__":
    for level, errors in measure(Path(sys.argv[1])).items():
        print(level, *(f"{name} {error:g}" for name, error in errors.items()), sep="\n  ")
