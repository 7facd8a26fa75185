"""`ngfsi gradient`: what is asked for, and how it is shown and written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ngfsi.case import Case
from ngfsi.errors import CaseError
from ngfsi.gradient.adjoint import Gradient, gradient_of
from ngfsi.gradient.parameters import parameters_of
from ngfsi.gradient.window import Window, wanted
from ngfsi.solve.initial import Say
from ngfsi.store.disk import explained
from ngfsi.store.table import write_rows
from ngfsi.units import symbol

KINDS = ("mean", "least", "change", "loss")
"""What may be made of a quantity, other than its value at the end."""
CHART = "gradient.png"
SHOWN = 40
"""Bars of the chart at most."""


def gradient(case: Case, of: str, by: str, window: str, folder: Path, say: Say) -> Gradient:
    """Compute a gradient, and write its numbers and a chart to a folder.

    Raises:
        CaseError: what is asked for is not there, or not known to gradients.
        OutputError: the folder cannot be written.
        MeshError, SolverError: as for a run.
    """
    from ngfsi.report.charts import GRADIENT
    from ngfsi.report.figures import bars

    quantity, kind = wanted(of, KINDS)
    parameters = parameters_of(case, [one.strip() for one in by.split(",")])
    found = gradient_of(case, quantity, Window(kind, *_times(window, kind)), parameters, say, folder=folder)
    with explained(folder, "written"):
        folder.mkdir(parents=True, exist_ok=True)
    write_rows(folder / GRADIENT, rows(found))
    largest = dict(list(found.elasticities().items())[:SHOWN])
    with explained(folder / CHART, "written"):
        bars(largest, f"change of {found.name} for 1 % of each parameter [%]", folder / CHART)
    return found


def _times(window: str, kind: str) -> tuple[float, ...]:
    if not window:
        return ()
    if kind not in ("mean", "least"):
        raise CaseError(f"--window {window} is for means: write --of QUANTITY_mean or --of tawss_least")
    try:
        start, end = map(float, window.split(","))
    except ValueError:
        raise CaseError(f"--window {window} is not understood: write two times in seconds, e.g. 0.5,1") from None
    return start, end


def rows(found: Gradient) -> list[dict[str, float | str]]:
    """Return a row for each parameter, largest elasticity first."""
    by_name = {one.name: one for one in found.parameters}
    return [{"quantity": found.name, "parameter": name, "value": by_name[name].value, "unit": by_name[name].unit,
             "derivative": found.derivatives[name], "elasticity": elasticity}
            for name, elasticity in found.elasticities().items()]  # fmt: skip


def table(found: Gradient) -> Any:
    """Return the table for the terminal, with what it took."""
    from rich.console import Group
    from rich.table import Column, Table

    unit = symbol(found.unit)
    shown = Table(
        "parameter", *(Column(head, justify="right") for head in ("value", "derivative", "% per %")),
        title=f"{found.name} = {found.value:.6g} {unit}".rstrip(),
    )  # fmt: skip
    for row in rows(found):
        own = symbol(str(row["unit"]))
        per = f"{unit or '1'} / {own or '1'}"
        shown.add_row(str(row["parameter"]), f"{row['value']:.6g} {own}", f"{row['derivative']:.6g} {per}",
                      f"{row['elasticity']:.4g}")  # fmt: skip
    memory, disk = found.stored_mb
    kept = f"{memory:.3g} MB of states in memory{f', {disk:.3g} MB on disk' if disk else ''}"
    took = ", ".join(f"{name} {seconds:.3g} s" for name, seconds in found.seconds.items())
    held = ["The steps that the run chose by its errors are held."] if found.own_steps else []
    return Group(shown, *held, f"{took}; {found.mean_iterations:.1f} iterations for each of {found.moments} states, "
                 f"{found.factorisations} factorisations, {kept}")  # fmt: skip
