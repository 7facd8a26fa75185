"""`ngfsi design`: what is asked for, and how it is written."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ngfsi.case import Case
from ngfsi.errors import CaseError
from ngfsi.gradient.design import Designed, Layout, Limits, improve
from ngfsi.mesh.domain import Domain
from ngfsi.solve.initial import Say
from ngfsi.store.disk import explained, replace_file
from ngfsi.store.table import write_rows
from ngfsi.units import UNITS, in_unit, suffixes, to_si

PRESSURES, STEPS, CASE, FIGURE = "pressures.csv", "steps.csv", "case.toml", "pressures.png"
QUANTITY = re.compile(r"([0-9.e+-]+) *([A-Za-z]+)")


def pressure(text: str, option: str) -> float:
    """Return a pressure (Pa) that is written with its unit.

    Raises:
        CaseError: it is not.
    """
    found = QUANTITY.fullmatch(text.strip())
    try:
        if found and UNITS[found[2]].dimension == "pressure":
            return to_si(float(found[1]), found[2])
    except (KeyError, ValueError):
        pass
    raise CaseError(f"{option} {text} is no pressure: write a number with one of {', '.join(suffixes('pressure'))}, "
                    "e.g. 12mmHg")  # fmt: skip


def grid(text: str) -> tuple[int, int]:
    """Return the numbers of rings and sectors.

    Raises:
        CaseError: they are not written so.
    """
    found = re.fullmatch(r"([1-9]\d*)x([1-9]\d*)", text)
    if not found or found[2] == "2":  # half of the skin on each side has two edges that are one
        raise CaseError(f"--cuffs {text} is not understood: write rings x sectors, e.g. 4x14; not two sectors")
    return int(found[1]), int(found[2])


def design(
    case: Case, of: str, cuffs: str, limits: Limits, folder: Path, say: Say, others: Sequence[Case] = ()
) -> Designed:
    """Find pressures on the skin, and write them to a folder.

    Args:
        others: cases that are to bear the same pressures.

    Raises:
        CaseError: the limits leave nothing, or the quantity has no gradient.
        OutputError: the folder cannot be written.
        MeshError, SolverError: as for a run.
    """
    from ngfsi.report.figures import pressures_on_skin

    shape, domain = grid(cuffs), Domain.build(case.geometry)
    found = improve(case, of, Layout.on(domain, *shape), limits, domain, say,
                    others=[(one, Domain.build(one.geometry)) for one in others])  # fmt: skip
    with explained(folder, "written"):
        folder.mkdir(parents=True, exist_ok=True)
    write_rows(folder / PRESSURES, [
        {"start_m": one.start, "end_m": one.end, "direction_rad": one.direction, "pressure_Pa": float(value)}
        for one, value in zip(found.layout.cuffs(found.pressures), found.pressures, strict=True)
    ])  # fmt: skip
    write_rows(folder / STEPS, [{"step": n, of: value} for n, value in enumerate(found.history)])
    replace_file(folder / CASE, found.case.to_toml().encode())
    layout = found.layout
    with explained(folder / FIGURE, "written"):
        pressures_on_skin(
            np.linspace(-np.pi, np.pi, layout.sectors + 1), np.linspace(layout.bottom, layout.top, layout.rings + 1),
            found.pressures.reshape(shape), folder / FIGURE,
        )  # fmt: skip
    return found


def sentence(found: Designed, of: str) -> str:
    """Say what was found."""
    gain = in_unit(found.value / found.history[0] - 1, "percent", ".3g")
    lost = f"{in_unit(found.loss, 'percent', '.3g')} of the volume"
    if not np.isnan(found.section_loss):
        lost += f" and {in_unit(found.section_loss, 'percent', '.3g')} of a section at most"
    return (f"{of} = {found.value:.5g} (SI), {gain} more than under the mean everywhere; {lost} is lost; "
            f"{found.runs} runs, {found.sweeps} sweeps of the adjoint")  # fmt: skip
