"""Figures that one study or another draws of stored runs and of plane sections. What they are given is SI; the axes
(`Shown`) convert it and say the unit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from ngfsi.outlines.outline import polygon_area
from ngfsi.report.figures import COLOURS, QUIET, new_figure, new_panels
from ngfsi.store.stored import StoredRun
from ngfsi.units import Shown, in_unit

Array = NDArray[np.float64]

OVERSHOOT = 1.15
MANY = 4
"""Lines in a panel beyond which their names stand below it."""
TIME, X, Y = Shown("time", "s"), Shown("x, lateral", "mm"), Shown("y, anterior", "mm")


@dataclass(frozen=True)
class Group:
    """What is drawn in one colour.

    Attributes:
        label: what stands beside the line.
        run: drawn as a line.
        band, band_label: runs whose range is shaded, e.g. the same material with other parameters, and what they are.
        colour: any of Matplotlib's.
    """

    label: str
    run: StoredRun
    band: tuple[StoredRun, ...] = ()
    band_label: str = ""
    colour: str = COLOURS[0]


def time_series(
    groups: Sequence[Group],
    quantity: Callable[[StoredRun], Array],
    shown: Shown,
    path: Path,
    *,
    comparison: tuple[str, Callable[[StoredRun], Array]] | None = None,
    events: Sequence[tuple[float, str]] = (),
    values: Sequence[tuple[float, str]] = (),
) -> None:
    """Draw a quantity over time; a cross marks the last value of a run that did not reach its end.

    Args:
        groups: what to compare.
        quantity: values at the times of a run's series.
        shown: the vertical axis.
        path: file to write; its suffix says the format.
        comparison: name and values of a second quantity, dashed in the same colours.
        events: times [s] to be marked, and what happens then.
        values: levels to be marked, and what they are.
    """
    figure, axes = new_figure(7.5, 4.4)

    def drawn(run: StoredRun) -> Array:
        return shown(quantity(run))

    for group in groups:
        times = group.run.series["time_s"]
        axes.plot(times, drawn(group.run), color=group.colour, marker="o", markersize=2.5, label=group.label)
        if group.run.status != "completed":  # it could not go on from here
            axes.plot(times[-1:], drawn(group.run)[-1:], color=group.colour, marker="X", markersize=8)
        if group.band:
            low, high = _range((group.run, *group.band), drawn, times)
            axes.fill_between(times, low, high, color=group.colour, alpha=0.2, linewidth=0, label=group.band_label)
        if comparison:
            axes.plot(times, shown(comparison[1](group.run)), color=group.colour, linestyle="--", linewidth=1.1)
    if comparison:
        axes.plot([], [], color=QUIET, linestyle="--", linewidth=1.1, label=comparison[0])
    for time, text in events:
        axes.axvline(time, color=QUIET, linestyle=":", linewidth=1)
        axes.annotate(text, (time, 1), (3, -3), xycoords=("data", "axes fraction"), textcoords="offset points",
                      fontsize=8, color=QUIET, va="top")  # fmt: skip
    for level, text in values:
        axes.axhline(shown(level), color=QUIET, linestyle="-.", linewidth=1)
        axes.annotate(text, (0, shown(level)), (3, 3), xycoords=("axes fraction", "data"), textcoords="offset points",
                      fontsize=8, color=QUIET)  # fmt: skip
    axes.set_xlabel(TIME.label)
    axes.set_ylabel(shown.label)
    axes.margins(x=0.02)
    _keep_readable(axes, groups, drawn)
    _legend_below(figure, axes)
    figure.savefig(path)


def outlines(groups: Sequence[Group], times: tuple[float, float], path: Path) -> None:
    """Draw the cross-section of the lumen at mid-length before and after, a panel per group.

    Args:
        groups: what to compare.
        times: before and after [s]; the stored outlines nearest to them are drawn.
        path: file to write.
    """
    figure, panels, columns = new_panels(len(groups), 4, (2.9, 3.7), (0.4, 0.5))
    for panel, group in zip(panels, groups, strict=False):
        _outline_panel(panel, group, times)
    _share_frame(panels[: len(groups)])
    for number, panel in enumerate(panels):
        panel.set_xlabel(X.label)
        if number % columns == 0:
            panel.set_ylabel(Y.label)
    figure.savefig(path)


def _keep_readable(axes: Axes, groups: Sequence[Group], quantity: Callable[[StoredRun], Array]) -> None:
    """Let runs that could not go on leave the frame if the others would be squeezed by them."""
    highest = {group.run.status == "completed": 0.0 for group in groups}
    for group in groups:
        done = group.run.status == "completed"
        highest[done] = max(highest[done], float(np.max(quantity(group.run))))
    if len(highest) == 2 and highest[False] > OVERSHOOT * highest[True] > 0:
        axes.set_ylim(top=OVERSHOOT * highest[True])


def stacked_series(
    panels: Mapping[str, tuple[Array, Mapping[str, Array]]], total: str, shown: Shown, path: Path
) -> None:
    """Draw parts over time one on the other, those below zero downwards, with their sum as a line; a panel per title.

    Args:
        panels: title -> times [s] and part -> values.
        total: what the sum is.
        shown: the vertical axis.
        path: file to write; its suffix says the format.
    """
    figure, spaces, _ = new_panels(len(panels), 3, (4.6, 3.8), (0.0, 0.5))
    for panel, (title, (times, parts)) in zip(spaces, panels.items(), strict=False):
        above, below = np.zeros_like(times), np.zeros_like(times)
        for colour, (part, si) in zip([QUIET, *COLOURS], parts.items(), strict=False):
            values = shown(si)
            for floor, layer, name in ((above, np.maximum(values, 0), part), (below, np.minimum(values, 0), None)):
                panel.fill_between(times, floor, floor + layer, color=colour, alpha=0.75, linewidth=0, label=name)
                floor += layer
        panel.plot(times, above + below, color="black", linewidth=1.6, label=total)
        panel.set_title(title, fontsize=10)
        panel.set_xlabel(TIME.label)
        panel.margins(x=0)
    spaces[0].set_ylabel(shown.label)
    low, high = (f(panel.get_ylim()[i] for panel in spaces[: len(panels)]) for i, f in ((0, min), (1, max)))
    for panel in spaces[: len(panels)]:
        panel.set_ylim(low, high)
    _legend_below(figure, spaces[0])
    figure.savefig(path)


@dataclass(frozen=True)
class FieldMap:
    """A field on triangles: points (n, 2), triangles (m, 3), values (n,), outlines (k, 2) to be drawn."""

    points: Array
    triangles: NDArray[np.int64]
    values: Array
    outlines: Sequence[Array] = ()


def mid_plane(run: StoredRun, name: str, factor: float) -> FieldMap:
    """Return a field of the end of a run, times a factor, in the plane x = 0, by z and y."""
    grid = run.fields(float(run.series["time_s"][-1]))
    cut = grid.slice(normal="x", origin=(0.0, 0.0, 0.0)).triangulate()
    triangles = np.asarray(cut.faces).reshape(-1, 4)[:, 1:]
    return FieldMap(np.asarray(cut.points)[:, [2, 1]], triangles, factor * np.asarray(cut.point_data[name]))


def field_maps(
    panels: Mapping[str, FieldMap], shown: Shown, path: Path, *, limits: tuple[float, float],
    axes: tuple[Shown, Shown] = (X, Y),
) -> None:  # fmt: skip
    """Draw a field over plane sections, a panel per title, with one scale of colours from `limits`."""
    figure, spaces, columns = new_panels(len(panels), 3, (3.6, 3.7), (0.9, 0.0))
    for number, (panel, (title, drawn)) in enumerate(zip(spaces, panels.items(), strict=False)):
        grid = Triangulation(axes[0](drawn.points[:, 0]), axes[1](drawn.points[:, 1]), drawn.triangles)
        colours = panel.tripcolor(grid, shown(drawn.values), shading="gouraud", cmap="cividis",
                                  vmin=shown(limits[0]), vmax=shown(limits[1]), rasterized=True)  # fmt: skip
        for outline in drawn.outlines:
            panel.plot(*_closed(outline), color=QUIET, linewidth=0.8, linestyle="--")
        panel.set_aspect("equal")
        panel.set_title(title, fontsize=10)
        panel.set_xlabel(axes[0].label)
        if number % columns == 0:
            panel.set_ylabel(axes[1].label)
    _share_frame(spaces[: len(panels)])
    figure.colorbar(colours, ax=spaces, label=shown.label, shrink=0.7, extend="both")
    figure.savefig(path)


@dataclass(frozen=True)
class SkinPressure:
    """A pressure on the skin: mean over a cycle at points of it, and over time in each chamber, Pa.

    Attributes:
        angles, heights, mean: of the points: around the axis (rad), m, Pa.
        times: s
        chambers: name -> (times,) Pa.
    """

    angles: Array
    heights: Array
    mean: Array
    times: Array
    chambers: Mapping[str, Array]


def skin_pressures(panels: Mapping[str, SkinPressure], path: Path) -> None:
    """Draw pressures on the unrolled skin, and below them over time, a column per title, on one scale each."""
    angle, height, time_in_cycle = Shown("angle", "deg"), Shown("height", "mm"), Shown("time in the cycle", "s")
    mean, pressure = Shown("mean pressure", "mmHg"), Shown("pressure", "mmHg")
    figure, axes = new_figure(2.5 * len(panels) + 0.8, 5.2, 2, len(panels))
    above, below = np.reshape(axes, (2, -1))
    most = max(mean(np.max(drawn.mean)) for drawn in panels.values())
    highest = max(pressure(np.max(values)) for drawn in panels.values() for values in drawn.chambers.values())
    for (title, drawn), skin, time in zip(panels.items(), above, below, strict=True):
        shown = skin.tricontourf(angle(drawn.angles), height(drawn.heights), mean(drawn.mean),
                                 levels=np.linspace(0, most, 13), cmap="cividis", extend="both")  # fmt: skip
        skin.set_title(title, fontsize=10)
        skin.set(xlabel=angle.label, xticks=(-180, -90, 0, 90, 180))
        for colour, (name, values) in zip(COLOURS, drawn.chambers.items(), strict=False):
            time.plot(drawn.times, pressure(values), color=colour, label=name)
        time.set(xlabel=time_in_cycle.label, ylim=(0, 1.05 * highest))
    above[0].set_ylabel(height.label)
    below[0].set_ylabel(pressure.label)
    below[0].legend(fontsize=8, frameon=False)
    figure.colorbar(shown, ax=list(np.ravel(axes)), label=mean.label, shrink=0.6)
    figure.savefig(path)


@dataclass(frozen=True)
class Effects:
    """Morris's effects of factors on a result: mu* with its half width of confidence, and sigma, all (factors,)."""

    factors: Sequence[str]
    mean: Array
    half_width: Array
    deviation: Array


NAMED = 0.15
"""Effects above this fraction of the largest have their names beside them."""


def elementary_effects(panels: Mapping[str, Effects], path: Path) -> None:
    """Draw mu* as bars with confidence, and sigma over mu*, a row per result; titles carry the units."""
    figure, axes = new_figure(11.0, 3.9 * len(panels), len(panels), 2)
    for (title, effects), (bars, plane) in zip(panels.items(), np.reshape(axes, (-1, 2)), strict=True):
        order = np.argsort(effects.mean)
        names = [effects.factors[n] for n in order]
        bars.barh(names, effects.mean[order], xerr=effects.half_width[order], color=COLOURS[0], capsize=3)
        bars.set_title(title, fontsize=10)
        bars.set_xlabel("mu*, over the whole range, with 95 % confidence")
        top = 1.15 * max(np.max(effects.mean + effects.half_width), np.max(effects.deviation))
        plane.errorbar(effects.mean, effects.deviation, xerr=effects.half_width, fmt="o", color=COLOURS[1],
                       markersize=4, capsize=2, linewidth=0.8)  # fmt: skip
        plane.plot([0, top], [0, top], color=QUIET, linestyle="--", linewidth=1, label="sigma = mu*")
        for n in order[effects.mean[order] > NAMED * effects.mean.max()]:
            right = effects.mean[n] > top / 2
            plane.annotate(effects.factors[n], (effects.mean[n], effects.deviation[n]), (-4 if right else 4, 4),
                           fontsize=7, textcoords="offset points", ha="right" if right else "left")  # fmt: skip
        plane.set(xlabel="mu*", ylabel="sigma", xlim=(0, top), ylim=(0, top))
        plane.set_title(title, fontsize=10)
        plane.legend(fontsize=8, frameon=False, loc="upper left")
    figure.savefig(path)


def _outline_panel(panel: Axes, group: Group, times: tuple[float, float]) -> None:
    before, after = (_middle_ring(group.run, time) for time in times)
    for (time, ring), colour in ((before, QUIET), (after, group.colour)):
        area = in_unit(polygon_area(ring), "mm2", ".1f")
        panel.plot(*_closed(ring), color=colour, label=f"t = {in_unit(time, 's', '.3g')}: {area}")
    panel.fill(*_closed(after[1]), color=group.colour, alpha=0.15, linewidth=0)
    panel.set_aspect("equal")
    panel.set_title(group.label, fontsize=10)
    panel.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), fontsize=8, frameon=False, handlelength=1.2)


def _middle_ring(run: StoredRun, time: float) -> tuple[float, Array]:
    """Return time [s] and outline (n, 2) [m] of the section at mid-length."""
    found, rings = run.outlines(time)
    return found, rings[len(rings) // 2, :, :2]


def _closed(outline: Array) -> tuple[Array, Array]:
    """Return what is drawn over x and y of an outline (n, 2) [m]."""
    x, y = np.vstack([outline, outline[:1]]).T
    return X(x), Y(y)


def _share_frame(panels: Sequence[Axes]) -> None:
    """Give panels of equal aspect the same extent in mm, each around its own middle."""
    size = max(max(np.ptp(panel.get_xlim()), np.ptp(panel.get_ylim())) for panel in panels)
    for panel in panels:
        x, y = np.mean(panel.get_xlim()), np.mean(panel.get_ylim())
        panel.set_xlim(x - size / 2, x + size / 2)
        panel.set_ylim(y - size / 2, y + size / 2)


def _range(runs: Sequence[StoredRun], quantity: Callable[[StoredRun], Array], times: Array) -> tuple[Array, Array]:
    """Return the smallest and largest value over runs at given times; a run counts as far as it came."""
    values = [np.interp(times, run.series["time_s"], quantity(run), right=np.nan) for run in runs]
    return np.nanmin(values, axis=0), np.nanmax(values, axis=0)


def _legend_below(figure: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False, fontsize=9)


@dataclass(frozen=True)
class Line:
    """Values over others: drawn as a line, or as markers alone; `spread`: half-widths of error bars."""

    label: str
    x: Sequence[float] | Array
    y: Sequence[float] | Array
    style: str = "o-"
    spread: Sequence[float] | Array | None = None


def lines(
    panels: Mapping[str, Sequence[Line]], shown: tuple[Shown, Shown], path: Path, *, ticks: Sequence[str] = (),
    log: tuple[bool, bool] = (False, False),
) -> None:  # fmt: skip
    """Draw values over others, a panel per title.

    Args:
        shown: the axes (x, y).
        ticks: names of 0, 1, ... on the axis of x.
        log: whether the axes (x, y) are logarithmic.
    """
    figure, spaces, columns = new_panels(len(panels), 2, (5.2, 4.0), (0.0, 0.0))
    for number, (panel, (title, drawn)) in enumerate(zip(spaces, panels.items(), strict=False)):
        for colour, line in zip(cycle(COLOURS), drawn, strict=False):
            x, y = (axis(np.asarray(values)) for axis, values in zip(shown, (line.x, line.y), strict=True))
            spread = None if line.spread is None else shown[1](np.asarray(line.spread))
            panel.errorbar(x, y, yerr=spread, fmt=line.style, color=colour, markersize=4,
                           linewidth=1.2, capsize=3, label=line.label)  # fmt: skip
        panel.set_title(title, fontsize=10)
        for name, axis in (
            pair for pair, wanted in zip((("x", panel.xaxis), ("y", panel.yaxis)), log, strict=True) if wanted
        ):
            panel.set(**{f"{name}scale": "log"})
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        panel.set_xlabel(shown[0].label)
        if number % columns == 0:
            panel.set_ylabel(shown[1].label)
        if ticks:
            panel.set_xticks(range(len(ticks)), ticks, rotation=25, ha="right")
        below: dict[str, Any] = (
            {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16), "ncols": 2} if len(drawn) > MANY else {}
        )
        panel.legend(fontsize=8, frameon=False, **below)
    figure.savefig(path)
