"""`ngfsi calibrate`: what is asked for, and how it is shown and written."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ngfsi.arrays import Array
from ngfsi.case import Case
from ngfsi.gradient.calibration import Runs, calibrate, read_data
from ngfsi.gradient.parameters import parameters_of, two_numbers
from ngfsi.identify.least_squares import LEVEL, Check, Fit, check
from ngfsi.report.tables import markdown_table
from ngfsi.solve.initial import Say
from ngfsi.store.disk import explained, replace_file
from ngfsi.store.table import write_rows
from ngfsi.units import in_unit, symbol

PARAMETERS, DATA, CASE, REPORT, FIGURE = "calibration.csv", "data.csv", "case.toml", "report.md", "calibration.png"
CHECK = "check.csv"
DOUBTFUL = 0.01
"""Probability of the gaps below which the model, or the errors, are not to be believed."""
BENT = 0.3
"""Part of the spread of runs that is not linear from which on intervals are not to be believed."""
STATION = re.compile(r"_z(\d\d)|_at_([\d.]+mm)")


@dataclass(frozen=True)
class Calibration:
    """What was found, and by which runs.

    Attributes:
        first: what the case as it was given has in place of the data.
        check: runs of parameters drawn from their covariance.
    """

    fit: Fit
    runs: Runs
    first: Array
    check: Check | None = None


def run(
    case: Case, data: Path, by: str, bounds: Sequence[str], priors: Sequence[str], folder: Path, say: Say,
    checked: int = 0,
) -> Calibration:  # fmt: skip
    """Calibrate parameters of a case, and write what was found to a folder.

    Args:
        checked: number of runs of parameters drawn from their covariance.

    Raises:
        CaseError, MaterialError: what is asked for is not there, not known to gradients, or not told by the data.
        OutputError: the data cannot be read, or the folder cannot be written.
        MeshError, SolverError: as for a run.
    """
    parameters = parameters_of(case, [one.strip() for one in by.split(",")])
    pairs = [dict(two_numbers(case, one, option) for one in texts)
             for texts, option in ((bounds, "--bounds"), (priors, "--prior"))]  # fmt: skip
    runs = Runs(case, parameters, read_data(data, case), say, folder=folder)
    first = runs.values(np.array([one.value for one in parameters]))
    fit = calibrate(runs, *pairs)
    found = Calibration(fit, runs, first, check(fit, runs.values, checked) if checked else None)
    with explained(folder, "written"):
        folder.mkdir(parents=True, exist_ok=True)
    write(found, folder)
    return found


def write(found: Calibration, folder: Path) -> None:
    """Write parameters, data beside what the runs give, the case with the parameters, a figure and a report."""
    from ngfsi.report.figures import Measurements, data_and_model

    write_rows(folder / PARAMETERS, rows(found))
    data = found.runs.data
    write_rows(folder / DATA, [
        {"quantity": one.name, "unit": one.unit, "time_s": one.time, "measured": one.value, "error": one.error,
         "before": before, "calibrated": after, "gap_over_error": gap}
        for one, before, after, gap in zip(data, found.first.tolist(), found.fit.model.tolist(),
                                           found.fit.gaps.tolist(), strict=True)
    ])  # fmt: skip
    if found.check is not None:
        names = [f"{one.name}_{one.unit}" for one in found.runs.parameters]
        write_rows(folder / CHECK, [
            dict(zip(names, values, strict=True)) | {f"{one.name}_at_{one.time:g}s_{one.unit}": value
                                                     for one, value in zip(data, model, strict=True)}
            for values, model in zip(found.check.values.tolist(), found.check.model.tolist(), strict=True)
        ])  # fmt: skip
    replace_file(folder / CASE, found.runs.case_of(found.fit.values).to_toml().encode())
    panels: dict[str, dict[str, Measurements]] = {}
    for place in np.argsort([one.time for one in data], kind="stable"):
        one, station = data[place], STATION.search(data[place].name)
        panel = panels.setdefault(f"{STATION.sub('', one.name)} [{symbol(one.unit) or '1'}]", {})
        label = (station[2] or f"z{station[1]}") if station else ""
        panel.setdefault(label, Measurements([], [], [], [], [])).add(
            one.time, one.value, one.error, found.first[place], found.fit.model[place]
        )
    with explained(folder / FIGURE, "written"):
        data_and_model(panels, folder / FIGURE)
    replace_file(folder / REPORT, report(found).encode())


def rows(found: Calibration) -> list[dict[str, float | str]]:
    """Return a row for each parameter."""
    fit = found.fit
    return [
        {"parameter": unknown.name, "unit": one.unit, "value": value, "sd": sd, "low": value - half,
         "high": value + half, "sd_others_known": alone, "start": unknown.start,
         "prior_mean": unknown.mean if np.isfinite(unknown.sd) else "",
         "prior_sd": unknown.sd if np.isfinite(unknown.sd) else ""}
        for unknown, one, value, sd, half, alone in zip(
            fit.unknowns, found.runs.parameters, fit.values.tolist(), fit.sd.tolist(), fit.half_width.tolist(),
            (1 / np.sqrt(np.diag(np.linalg.inv(fit.covariance)))).tolist(), strict=True)
    ]  # fmt: skip


def sentences(found: Calibration) -> list[str]:
    """Say what is known least, whether the model fits, and what it took."""
    fit, runs = found.fit, found.runs
    squares = float(fit.gaps @ fit.gaps)
    said = [fit.verdict()] if len(fit.unknowns) > 1 else []
    fits = f"Sum of squares of gaps over errors {squares:.3g} for {len(fit.gaps)} data, {fit.freedom} more than "
    fits += "parameters without a prior"
    if fit.freedom > 0:
        fits += f"; as much or more has the probability {fit.probability:.2g}"
    said.append(f"{fits}.")
    if fit.probability < DOUBTFUL:
        said.append("The model does not fit the data within their errors: one of the two is wrong, and the intervals "
                    "are too narrow.")  # fmt: skip
    said += [f"{name} stands at a bound: its interval is that of a free parameter." for name in fit.at_bounds]
    if found.check is not None:
        said.append(of_check(found.check, np.array([one.error for one in runs.data])))
    way = f"{runs.sweeps} sweeps of the adjoint" if runs.sweeps else "differences of runs"
    said.append(f"{runs.runs} runs, slopes by {way}.")
    return said


def of_check(runs: Check, errors: Array) -> str:
    """Say whether the intervals are those of the runs themselves, not of their linearised model."""
    of_runs, linear = (float(np.sqrt(np.mean((one / errors) ** 2))) for one in (runs.spread, runs.linear_spread))
    said = f"{len(runs.values)} runs of parameters drawn from their covariance spread the data by "
    said += f"{of_runs:.2g} errors, by the linear model {linear:.2g}; "
    said += f"{in_unit(runs.bend, 'percent', '.2g')} of that is not linear"
    said += ", too much for the intervals." if runs.bend > BENT else "."
    return said + (f" {runs.failed} more had no solution." if runs.failed else "")


def report(found: Calibration) -> str:
    """Return the report in Markdown."""
    fit = found.fit
    names = [one.name for one in fit.unknowns]
    text = [f"# Calibration of {found.runs.case.name}\n"]
    text.append(markdown_table(
        ["parameter", "unit", "value", "standard deviation", f"{100 * LEVEL:g} % interval",
         "standard deviation with the others known", "before"],
        [[f"`{row['parameter']}`", symbol(str(row["unit"])), f"{row['value']:.5g}", f"{row['sd']:.2g}",
          f"{row['low']:.5g} to {row['high']:.5g}", f"{row['sd_others_known']:.2g}", f"{row['start']:.5g}"]
         for row in rows(found)],
    ))  # fmt: skip
    text += [f"{one}\n" for one in sentences(found)]
    if len(names) > 1:
        text.append("## Correlations\n")
        text.append(markdown_table(["", *(f"`{name}`" for name in names)], [
            [f"`{name}`", *(f"{one:.3f}" for one in line)] for name, line in zip(names, fit.correlation, strict=True)
        ]))  # fmt: skip
    text.append("## Data\n")
    text.append(
        "Dots: measured, with standard errors; crosses, dotted: the case before; dashes, lines: the calibrated one, at "
        "the times of the data.\n"
    )
    text.append(f"![Data and model]({FIGURE})\n")
    return "\n".join(text)


def table(found: Calibration) -> Any:
    """Return the table for the terminal, with what is to be said of it."""
    from rich.console import Group
    from rich.table import Column, Table

    shown = Table("parameter", *(Column(head, justify="right")
                                 for head in ("value", "sd", f"{100 * LEVEL:g} % interval", "before")))  # fmt: skip
    for row in rows(found):
        unit = symbol(str(row["unit"]))
        shown.add_row(str(row["parameter"]), f"{row['value']:.5g} {unit}", f"{row['sd']:.2g}",
                      f"{row['low']:.5g} to {row['high']:.5g}", f"{row['start']:.5g}")  # fmt: skip
    return Group(shown, *sentences(found))
