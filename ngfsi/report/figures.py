"""Figures of tables, by Matplotlib: convergence, signals, bars, results over inputs. What stored runs hold over
time and space is drawn by charts.py."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imread

from ngfsi.arrays import Array
from ngfsi.units import Shown

TRUE_TYPE = 42
"""Fonts of a PDF that journals accept, and that drawing programs can edit."""

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
"""Palette of Okabe and Ito, which colour-blind readers tell apart."""

QUIET = "#777777"


@dataclass(frozen=True)
class Convergence:
    """Errors over sizes, and the slope expected of them, if any."""

    label: str
    sizes: Sequence[float]
    errors: Sequence[float]
    slope: float | None = None


def convergence(
    panels: Mapping[str, Sequence[Convergence]], path: Path,
    shown: tuple[Shown, Shown] = (Shown("size h", "1"), Shown("error", "1")),
    levels: Mapping[str, float] | None = None, marks: Mapping[str, float] | None = None,
) -> None:  # fmt: skip
    """Draw errors over sizes, a panel per title, with the expected slope dashed through the finest error.

    Args:
        shown: the axes, of sizes and errors, which are SI.
        levels: by title an error to be reached, drawn as a dotted line.
        marks: by name a size whose error is not known, drawn as a dash-dotted line from bottom to top.
    """
    figure, spaces, _ = new_panels(len(panels), 3, (4.2, 3.6), (0.0, 0.0))
    for panel, (title, lines) in zip(spaces, panels.items(), strict=False):
        for (marker, colour), line in zip(product("os^", COLOURS), lines, strict=False):
            x, y = (axis(np.array(values)) for axis, values in zip(shown, (line.sizes, line.errors), strict=True))
            panel.loglog(x, y, f"{marker}-", color=colour, markersize=4, label=line.label)
            if line.slope is not None:
                panel.loglog(
                    x, y[-1] * (x / x[-1]) ** line.slope, "--", color=colour, linewidth=1, label=f"slope {line.slope:g}"
                )
        sizes = sorted({shown[0](size) for line in lines for size in line.sizes})
        if len(sizes) < 8:
            panel.set_xticks(sizes, [f"{size:.3g}" for size in sizes])
            panel.set_xticks([], minor=True)
        for name, size in (marks or {}).items():
            panel.axvline(shown[0](size), color=QUIET, linestyle="-.", linewidth=1)
            panel.text(shown[0](size), 0.02, f" {name}", transform=panel.get_xaxis_transform(), rotation=90, fontsize=6,
                       color=QUIET, ha="right", va="bottom")  # fmt: skip
        if levels:
            panel.axhline(shown[1](levels[title]), color=QUIET, linestyle=":", linewidth=1)
        panel.set_title(title, fontsize=10)
        panel.set_xlabel(shown[0].label)
        panel.legend(fontsize=8 if len(lines) < 6 else 6, frameon=False)
    spaces[0].set_ylabel(shown[1].label)
    figure.savefig(path)


def signals_over_time(columns: Sequence[str], rows: Array, path: Path) -> None:
    """Draw each column over the first, the time, in a panel of its own."""
    figure, spaces, _ = new_panels(len(columns) - 1, 2, (5.2, 2.6), (0.0, 0.0))
    for panel, name, values in zip(spaces, columns[1:], rows.T[1:], strict=False):
        panel.plot(rows[:, 0], values, color=COLOURS[0], linewidth=1)
        panel.set_ylabel(name)
        panel.set_xlabel(columns[0])
    figure.savefig(path)


WIDEST_NAME = 14
"""Characters that fit under a bar."""


def stacked_bars(parts: Mapping[str, Mapping[str, float]], shown: Shown, path: Path) -> None:
    """Draw a bar for each of what is compared, of parts one on the other; parts -> name -> SI value."""
    names = list(next(iter(parts.values())))
    figure, axes = new_figure(2.4 + 1.3 * len(names), 4.2)
    below = np.zeros(len(names))
    shades = [*COLOURS, *(f"{colour}80" for colour in COLOURS)]
    for colour, (part, values) in zip(shades, parts.items(), strict=False):
        heights = shown(np.array([values[name] for name in names]))
        axes.bar(names, heights, bottom=below, color=colour, width=0.6, label=part)
        below += heights
    axes.set_xticks(range(len(names)), [fill(name, WIDEST_NAME) for name in names])
    axes.set_ylabel(shown.label)
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles[::-1], labels[::-1], fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path)


def bars(values: Mapping[str, float], label: str, path: Path) -> None:
    """Draw a bar to either side for each value, the first on top."""
    longest = max(map(len, values))
    figure, axes = new_figure(4.4 + 0.075 * longest, 1.2 + 0.28 * len(values))
    axes.barh(
        range(len(values)), list(values.values()), color=[COLOURS[int(v < 0)] for v in values.values()], height=0.7
    )
    axes.set_yticks(range(len(values)), list(values), fontsize=8)
    axes.invert_yaxis()
    axes.axvline(0.0, color=QUIET, linewidth=1)
    axes.set_xlabel(label)
    figure.savefig(path)


@dataclass(frozen=True)
class Measurements:
    """Values measured over time with their standard errors, and those of a model before and after it was fitted."""

    times: list[float]
    measured: list[float]
    errors: list[float]
    before: list[float]
    after: list[float]

    def add(self, time: float, measured: float, error: float, before: float, after: float) -> None:
        """Add one."""
        for values, value in zip(
            (self.times, self.measured, self.errors, self.before, self.after), (time, measured, error, before, after),
            strict=True,
        ):  # fmt: skip
            values.append(value)


def data_and_model(panels: Mapping[str, Mapping[str, Measurements]], path: Path) -> None:
    """Draw measured values with their errors and the model's: a panel per title, a colour per label."""
    figure, spaces, _ = new_panels(len(panels), 3, (4.4, 3.4), (0.0, 0.0))
    for panel, (title, lines) in zip(spaces, panels.items(), strict=False):
        for number, (label, one) in enumerate(lines.items()):
            colour = COLOURS[number % len(COLOURS)]
            panel.errorbar(one.times, one.measured, one.errors, fmt="o", color=colour, markersize=3, label=label)
            panel.plot(one.times, one.before, "x:", color=colour, linewidth=1, markersize=4)
            panel.plot(one.times, one.after, "_-", color=colour, linewidth=1, markersize=8)
        panel.set_ylabel(title)
        panel.set_xlabel("time [s]")
        if any(lines):
            panel.legend(fontsize=6, frameon=False)
    figure.savefig(path)


def pressures_on_skin(angles: Array, heights: Array, pressures: Array, path: Path, picture: Path | None = None) -> None:
    """Draw the pressures of fields of the unrolled skin.

    Args:
        angles, heights: ends of the fields (rad, m).
        pressures: (heights - 1, angles - 1) Pa.
        picture: of the same pressures on the segment in the same colours, for the left.
    """
    angle, height, pressure = Shown("angle from x, lateral", "deg"), Shown("height", "mm"), Shown("pressure", "mmHg")
    if picture is None:
        figure, axes = new_figure(6.4, 3.4)
    else:
        figure, (beside, axes) = new_figure(11.0, 3.4, 1, 2)
        beside.imshow(imread(picture))
        beside.set_title("from the side that is pressed most, and opposite; ends of the vein red", fontsize=8)
        beside.set_axis_off()
    drawn = axes.pcolormesh(angle(angles), height(heights), pressure(pressures), cmap="cividis", vmin=0)
    axes.set(xlabel=angle.label, ylabel=height.label, xticks=(-180, -90, 0, 90, 180))
    figure.colorbar(drawn, ax=axes, label=pressure.label)
    figure.savefig(path)


def pressures_over_time(names: Sequence[str], times: Sequence[float], pressures: Array, path: Path) -> None:
    """Draw cycles of pressures, a row for each place.

    Args:
        times: (n,) s, from 0 to the end of a cycle.
        pressures: (names, n - 1) Pa, at the times but for the last.
    """
    time, pressure = Shown("time in the cycle", "s"), Shown("pressure", "mmHg")
    fine = np.linspace(0.0, times[-1], 201)
    rows = [np.interp(fine, times, [*one, one[0]]) for one in pressures]
    middles = (fine[1:] + fine[:-1]) / 2
    values = np.array([np.interp(middles, fine, one) for one in rows])
    figure, axes = new_figure(6.4, 1.4 + 0.3 * len(names))
    drawn = axes.pcolormesh(time(fine), np.arange(len(names) + 1) - 0.5, pressure(values), cmap="cividis", vmin=0)
    axes.set(xlabel=time.label, yticks=range(len(names)), yticklabels=names)
    figure.colorbar(drawn, ax=axes, label=pressure.label)
    figure.savefig(path)


MOST_PANELS = 14
"""Inputs that fit beside each other."""


def results_over_inputs(
    inputs: Mapping[str, Sequence[float]], results: Mapping[str, Sequence[float]], path: Path
) -> None:
    """Draw every result over every input, of all cases: a row per result, a column for each of the first inputs."""
    shown = dict(list(inputs.items())[:MOST_PANELS])
    figure, axes = new_figure(1.6 + 1.7 * len(shown), 1.0 + 1.8 * len(results), len(results), len(shown))
    rows = np.reshape(axes, (len(results), len(shown)))
    for (result, found), row in zip(results.items(), rows, strict=True):
        for values, panel in zip(shown.values(), row, strict=True):
            panel.plot(values, found, "o", color=COLOURS[0], markersize=2.5, alpha=0.7)
            panel.tick_params(labelsize=7, labelleft=panel is row[0], labelbottom=False)
        row[0].set_ylabel(result, fontsize=7)
    for panel, name in zip(rows[-1], shown, strict=True):
        panel.set_xlabel(name, fontsize=7)
        panel.tick_params(labelbottom=True)
    figure.savefig(path)


def new_panels(
    count: int, most: int, size: tuple[float, float], margin: tuple[float, float]
) -> tuple[Figure, list[Axes], int]:
    """Return a figure, its panels in rows of at most `most`, those beyond `count` empty, and the number of columns."""
    columns = min(count, most)
    rows = -(-count // columns)
    figure, axes = new_figure(size[0] * columns + margin[0], size[1] * rows + margin[1], rows, columns)
    panels: list[Axes] = list(np.ravel(axes))
    for panel in panels[count:]:
        panel.set_axis_off()
    return figure, panels, columns


class PrintedFigure(Figure):
    """A figure that is saved for the screen as it is named, and beside that as PDF for a paper, with its fonts."""

    def savefig(self, fname: Any, **options: Any) -> None:
        """Save the figure and its PDF."""
        super().savefig(fname, **options)
        with rc_context({"pdf.fonttype": TRUE_TYPE}):
            super().savefig(Path(fname).with_suffix(".pdf"), **options)


def new_figure(width: float, height: float, rows: int = 1, columns: int = 1) -> tuple[Figure, Any]:
    """Return a figure of a size in inches and its axes, without touching pyplot's global state."""
    figure = PrintedFigure(figsize=(width, height), layout="constrained", dpi=150)
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns)
    for panel in np.ravel(axes):
        panel.grid(color="#dddddd")
        panel.set_axisbelow(True)
        panel.spines[["top", "right"]].set_visible(False)
    return figure, axes
