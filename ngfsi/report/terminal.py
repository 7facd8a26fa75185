"""Tables for the terminal: a stored run, the parameter sets of materials, the installation."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import ngsolve
from rich.console import Console, Group, RenderableType
from rich.table import Column, Table
from rich.text import Text

from ngfsi.case import Case
from ngfsi.linear.backends import BACKENDS, choose_backend
from ngfsi.materials import available_sets, read_set
from ngfsi.mesh.generate import cache_folder
from ngfsi.report.tables import ERRORS_HEAD, error_rows, error_value, flat
from ngfsi.store.provenance import named_commit, versions
from ngfsi.store.stored import StoredRun
from ngfsi.units import Shown, in_unit, symbol, unit_of

PIPED_WIDTH = 160
"""Columns where the output is no terminal and need not be folded."""


def console() -> Console:
    """Return a console on standard output that does not fold tables when its output is piped."""
    found = Console()
    return found if found.is_terminal else Console(width=PIPED_WIDTH)


def run_summary(run: StoredRun) -> RenderableType:
    """Return what is known of a run: case, how it ended, mesh, effort, the last row of its series, estimated errors."""
    case, manifest = run.case, run.manifest
    facts = {
        "folder": str(run.path),
        "case": f"{case.name}: {_solids(case)}, {type(case.geometry).__name__}, "
        f"order {case.discretisation.order}, {case.time.scheme}, {in_unit(case.time.end, 's')} in steps of "
        f"{in_unit(case.time.step, 's')}",
        "status": " - ".join(filter(None, (run.status, manifest.get("reason", "")))),
        "code": _code(manifest),
    }
    rest = {key: value for key, value in manifest.items() if key not in _SHOWN}
    said = {key: value for key, value in flat(rest).items() if value not in (None, [], "")}
    return Group(_pairs({**facts, **said}), *_last_row(run), *([errors(run)] if run.errors else []))


def errors(run: StoredRun) -> RenderableType:
    """Return the estimated errors of a run."""
    first, *rest = ERRORS_HEAD
    table = Table(first, *(Column(head, justify="right") for head in rest), title="Estimated errors")
    for row in error_rows(run):
        table.add_row(*row)
    return table


def refinements(runs: Sequence[StoredRun], values: Sequence[Sequence[Mapping[str, float | str]]]) -> RenderableType:
    """Return runs on meshes that are refined one after the other, with rows of quantity, value and unit of each."""
    heads = [str(row["quantity"]) for row in values[0]]
    table = Table("mesh", *(Column(head, justify="right") for head in ("elements", "unknowns", *heads)),
                  title="Refinements")  # fmt: skip
    for number, (run, rows) in enumerate(zip(runs, values, strict=True)):
        sizes = (run.manifest["mesh"]["elements"], run.manifest["unknowns"])
        table.add_row(f"refined_{number}" if number else "as given", *(f"{size:,}" for size in sizes),
                      *map(error_value, rows))  # fmt: skip
    return table


def installation() -> RenderableType:
    """Return the versions and the solver that a run would use here."""
    facts: dict[str, Any] = dict(versions())
    facts["linear solver"] = choose_backend("auto")
    for name, backend in BACKENDS.items():
        facts[f"  {name}"] = backend.missing() or backend.about
    facts["threads"] = f"{ngsolve.ngsglobals.numthreads} of {os.cpu_count()} processors"
    facts["mesh cache"] = str(cache_folder())
    return _pairs(facts)


def materials() -> RenderableType:
    """Return the parameter sets with their initial moduli, and what is odd about them."""
    table = Table("set", "law", *(Column(head.head, justify="right") for head in _NUMBERS), title="Parameter sets")
    listed = [read_set(name) for name in available_sets()]
    for entry in listed:
        values = ((shown, form, getattr(entry.material, name, None)) for shown, (name, form) in _NUMBERS.items())
        numbers = ("" if value is None else f"{shown(value):{form}}" for shown, form, value in values)
        table.add_row(entry.name, entry.material.law, *numbers)
    odd = [Text(f"! {entry.name}: {flag}", style="yellow") for entry in listed for flag in entry.flags]
    return Group(table, *odd)


_NUMBERS: dict[Shown, tuple[str, str]] = {
    Shown("G0", "kPa"): ("shear_modulus", ".4g"), Shown("K0", "kPa"): ("bulk_modulus", ".4g"),
    Shown("E0", "kPa"): ("youngs_modulus", ".4g"), Shown("nu0", "1"): ("poissons_ratio", ".3f"),
    Shown("", "kg_m3"): ("density", "g"), Shown("", "mPa_s"): ("nominal_viscosity", ".4g"),
}  # fmt: skip
"""Head -> attribute of a law, digits."""
_SHOWN = ("case", "case_digest", "status", "reason", "versions", "commit", "vessels")


def _solids(case: Case) -> str:
    """Return what the solids are made of: the tissue alone if there is one, which all else follows."""
    solids = case.geometry.solids
    named = [name for name in solids if name == "tissue"] or solids
    return ", ".join(f"{case.materials.law_of(name).label} {name}" for name in named) or "rigid wall"


def _code(manifest: Mapping[str, Any]) -> str:
    found = manifest.get("versions", {})
    text = ", ".join(f"{name} {found[name]}" for name in ("ngfsi", "ngsolve", "python") if name in found)
    return text + named_commit(manifest)


def _last_row(run: StoredRun) -> list[RenderableType]:
    if not run.series or not len(run.series["time_s"]):
        return [Text("no step is stored yet")]
    number = len(run.series["time_s"])
    table = Table("quantity", Column("value", justify="right"), "unit", title=f"Last of {number} stored times")
    for column, values in run.series.items():
        unit = unit_of(column)
        table.add_row(column.removesuffix(f"_{unit}"), f"{values[-1]:.6g}", symbol(unit))
    return [table]


def _pairs(facts: Mapping[str, Any]) -> Table:
    table = Table.grid("", "", padding=(0, 2))
    for key, value in facts.items():
        table.add_row(Text(key, style="bold"), Text(str(value)))
    return table
