"""`ngfsi design`: what is asked for, and how it is written."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array
from ngfsi.case import Case
from ngfsi.conditions.loads import SKIN
from ngfsi.config.columns import all_columns
from ngfsi.errors import CaseError
from ngfsi.gradient.design import Designed, Layout, Limits, Pressed, improve
from ngfsi.gradient.design_in_time import Cycle, Cycled
from ngfsi.mesh.domain import Domain
from ngfsi.solve.initial import Say
from ngfsi.store.disk import explained, replace_file
from ngfsi.store.table import write_rows
from ngfsi.units import UNITS, in_unit, suffixes, to_si

PRESSURES, STEPS, CASE, FIGURE, CYCLE_FIGURE = "pressures.csv", "steps.csv", "case.toml", "pressures.png", "cycle.png"
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
    case: Case, of: str, cuffs: str, limits: Limits, folder: Path, say: Say, others: Sequence[Case] = (),
    start: Path | None = None, times: str = "",
) -> Designed:  # fmt: skip
    """Find pressures on the skin, and write them to a folder.

    Args:
        others: cases that are to bear the same pressures.
        start: pressures to begin with, as this writes them.
        times: of a cycle, at which pressures are free; empty: they stand still.

    Raises:
        CaseError: the limits leave nothing, or the quantity has no gradient.
        OutputError: the folder cannot be written.
        MeshError, SolverError: as for a run.
    """
    from ngfsi.report.figures import pressures_over_time

    shape, domain = grid(cuffs), Domain.build(case.geometry)
    layout = Layout.on(domain, *shape)
    if times:
        layout = Cycle.of(layout, seconds(times), case)
    begun = None if start is None else read_pressures(start, layout)
    with explained(folder, "written"):
        folder.mkdir(parents=True, exist_ok=True)
    found = improve(case, of, layout, limits, domain, say, start=begun, folder=folder,
                    of=Cycled if times else Pressed,
                    others=[(one, Domain.build(one.geometry)) for one in others])  # fmt: skip
    write_rows(folder / PRESSURES, rows(found))
    write_rows(folder / STEPS, [{"step": n, of: value} for n, value in enumerate(found.history)])
    replace_file(folder / CASE, found.case.to_toml().encode())
    picture(found, domain, folder / FIGURE, say)
    if isinstance(layout, Cycle):
        with explained(folder / CYCLE_FIGURE, "written"):
            pressures_over_time(labels(layout), layout.times, layout.over_time(found.pressures), folder / CYCLE_FIGURE)
    return found


def seconds(text: str) -> tuple[float, ...]:
    """Return times (s) that are written with commas.

    Raises:
        CaseError: they are not numbers.
    """
    try:
        return tuple(map(float, text.split(",")))
    except ValueError:
        raise CaseError(f"--times {text} is not understood: write seconds, e.g. 0,0.5,1,1.5,2") from None


def rows(found: Designed) -> list[dict[str, float | str]]:
    """Return a row for each pressure."""
    layout = found.layout
    times = layout.times[:-1] if isinstance(layout, Cycle) else (None,)
    pressures = iter(found.pressures.tolist())
    return [
        {"start_m": cuff.start, "end_m": cuff.end, "direction_rad": cuff.direction}
        | ({} if time is None else {"time_s": time}) | {"pressure_Pa": next(pressures)}
        for cuff in layout.cuffs(found.pressures) for time in times
    ]  # fmt: skip


def labels(layout: Layout) -> list[str]:
    """Return where each cuff is: the middle of its height, and its direction where there are several around."""
    height = (layout.top - layout.bottom) / layout.rings
    return [
        in_unit(layout.bottom + (ring + 0.5) * height, "mm", ".0f")
        + (f", {in_unit(layout.direction(sector), 'deg', '.0f')}" if layout.sectors > 1 else "")
        for ring in range(layout.rings) for sector in range(layout.sectors)
    ]  # fmt: skip


def read_pressures(path: Path, layout: Layout) -> Array:
    """Return the pressures (Pa) of a file that a design has written.

    Raises:
        CaseError: they are not those of so many cuffs.
        OutputError: the file cannot be read.
    """
    columns = all_columns(path)
    unit, values = columns.get("pressure", ("", np.zeros(0)))
    if unit not in UNITS or UNITS[unit].dimension != "pressure" or len(values) != layout.count:
        raise CaseError(f"--start '{path}' has no column pressure_Pa of {layout.count} values: give the {PRESSURES} of "
                        "a design with as many cuffs and times")  # fmt: skip
    return np.asarray(values)


def picture(found: Designed, domain: Domain, path: Path, say: Say) -> None:
    """Draw the pressures, of cycles their means, on the segment and on its unrolled skin, or on the latter alone where
    there is no OpenGL."""
    from ngfsi.report.figures import pressures_on_skin
    from ngfsi.report.skin_picture import skin_picture

    layout, scratch, pressures = found.layout, path.with_name(f".{path.name}"), found.pressures
    if isinstance(layout, Cycle):
        pressures = layout.mean(pressures)
    cuffs = zip(pressures.tolist(), layout.cuffs(found.pressures), strict=True)
    on_skin = sum((pressure * cuff.weight() for pressure, cuff in cuffs), ng.CF(0.0))
    if why := skin_picture(domain, SKIN, on_skin, float(pressures.max()) or 1.0, scratch):
        say(why)
    with explained(path, "written"):
        pressures_on_skin(
            np.linspace(-np.pi, np.pi, layout.sectors + 1), np.linspace(layout.bottom, layout.top, layout.rings + 1),
            pressures.reshape(layout.rings, layout.sectors), path, scratch if not why else None,
        )  # fmt: skip
        scratch.unlink(missing_ok=True)


def sentence(found: Designed, of: str) -> str:
    """Say what was found."""
    gain = in_unit(found.value / found.history[0] - 1, "percent", ".3g")
    lost = f"{in_unit(found.loss, 'percent', '.3g')} of the volume"
    if not np.isnan(found.section_loss):
        lost += f" and {in_unit(found.section_loss, 'percent', '.3g')} of a section at most"
    left = in_unit(found.promised, "percent", ".2g")
    return (f"{of} = {found.value:.5g} (SI), {gain} more than under the pressures begun with; {lost} is lost; mean "
            f"pressure {in_unit(found.mean, 'mmHg', '.3g')}; "
            f"{found.runs} runs, {found.sweeps} sweeps of the adjoint; gradients promise {left} more by steps of "
            f"{in_unit(found.region, 'mmHg', '.2g')}")  # fmt: skip
