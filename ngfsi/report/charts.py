"""Interactive charts of stored runs (plotly): each function returns a figure, values under the pointer, units on all
axes. Values are SI up to the axis (`Shown`) that they are drawn over, which converts them and says the unit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pyvista as pv
from plotly.subplots import make_subplots

from ngfsi.analysis.decomposition import decompose
from ngfsi.analysis.transmission import Surroundings
from ngfsi.analysis.tube import Comparison, externals, transmural, tube_laws
from ngfsi.arrays import Array
from ngfsi.report.figures import COLOURS, QUIET
from ngfsi.report.shapes import (
    FROM_ABOVE,
    FROM_THE_SIDE,
    MOVED,
    OFF_FACES,
    SHEAR,
    WSS,
    course,
    evenly,
    first_and_loaded,
    is_plane,
    lower_half,
    middle,
    solids,
    unroll,
)
from ngfsi.store.fields import COLLAPSE
from ngfsi.store.stored import StoredRun
from ngfsi.store.table import read_rows
from ngfsi.store.vessels import Frame
from ngfsi.units import Shown, in_unit, symbol

Runs = Mapping[str, StoredRun]
"""Title -> run, in the order of their colours."""

SCALE = "Viridis"
"""Of the colours of fields: even steps of brightness, for colour-blind readers too."""
LONGEST = 1.9
"""Longest side of a scene, in plotly's units."""
CUT_POINTS = 181
"""Points across a cut."""
GRADIENT, MOST_BARS = "gradient.csv", 40
"""File of a gradient, and how many of its parameters are drawn."""
MODE_DRAWN = 0.4
"""Largest motion of a mode that is drawn, over the size of the geometry: of a vein, the lumen's radius."""

TIME, POSITION = Shown("time", "s"), Shown("position along the vein", "mm")
SAWSS, PRESSURE = Shown("SAWSS", "Pa"), Shown("hydrostatic pressure", "kPa")
RELATIVE = Shown("relative size", "1")
SPACE = tuple(Shown(name, "mm") for name in "xyz")


def over_time(
    runs: Runs, lines: Mapping[str, str | Callable[[StoredRun], Array]], shown: Shown, *, dashed: Sequence[str] = ()
) -> go.Figure:
    """Return quantities over time, a colour per run and a line per quantity.

    Args:
        lines: name -> column of the series, or what returns SI values at its times.
        shown: the vertical axis.
        dashed: names of those drawn dashed.
    """
    figure = _figure(TIME, shown)
    for (title, run), colour in zip(runs.items(), COLOURS, strict=False):
        for name, of in lines.items():
            values = run.series[shown.check(of)] if isinstance(of, str) else of(run)
            text = f"{title}: {name}" if len(lines) > 1 else title
            dash = "dash" if name in dashed else "solid"
            _line(figure, (TIME, shown), run.series["time_s"], values, text, colour, dash)
    return figure


def causes(runs: Runs) -> go.Figure:
    """Return the rise of SAWSS by cause over time, stacked, a panel per run."""
    figure = _panels(list(runs), TIME, SAWSS, shared_yaxes=True)
    for column, run in enumerate(runs.values(), start=1):
        times, place = run.series["time_s"], _place(column)
        for colour, (cause, values) in zip([QUIET, *COLOURS], decompose(run.series).items(), strict=False):
            figure.add_bar(x=TIME(times), y=SAWSS(values), name=cause, marker_color=colour, legendgroup=cause, **place)
        _line(figure, (TIME, SAWSS), times, run.series["sawss_Pa"], "computed", "black", legendgroup="computed",
              **place)  # fmt: skip
    return figure.update_layout(barmode="relative", bargap=0)


def along_vein(runs: Runs, name: str, shown: Shown) -> go.Figure:
    """Return a quantity that the series hold for each station, over the position along the vessel: first (dotted) and
    under the largest load."""
    figure = _figure(POSITION, shown)
    for (title, run), colour in zip(runs.items(), COLOURS, strict=False):
        values = run.along(name, shown.si)
        positions = np.linspace(0, course(run).length, values.shape[1])
        for row, dash in ((0, "dot"), (run.series["time_s"].searchsorted(run.loaded_time), "solid")):
            text = f"{title}, {_at(run.series['time_s'][row])}"
            _line(figure, (POSITION, shown), positions, values[row], text, colour, dash, "lines+markers")
    return figure


def elasticities(runs: Runs) -> go.Figure:
    """Return a bar for each parameter of the gradient that lies in the folder of a run, the largest on top."""
    (run,) = runs.values()
    rows = read_rows(run.path / GRADIENT)[:MOST_BARS]
    names = [str(row["parameter"]) for row in rows]
    values = [float(row["elasticity"]) for row in rows]
    colours = [COLOURS[int(value < 0)] for value in values]
    figure = _figure(Shown(f"change of {rows[0]['quantity']} for 1 % of each parameter", "percent"), Shown("", "1"))
    figure.add_bar(x=values, y=names, orientation="h", marker_color=colours)
    figure.update_yaxes(autorange="reversed", automargin=True)
    return figure.update_layout(height=160 + 22 * len(rows))


def tube_law(runs: Runs) -> go.Figure:
    """Return the area at mid-length over the transmural pressure against the skin (filled) and against the tissue's
    traction on the wall (hollow), with the laws fitted to the first there is, a panel per run."""
    axes = Shown("transmural pressure", "kPa"), Shown("area at mid-length", "mm2")
    figure = _panels(list(runs), *axes, shared_yaxes=True)
    for column, run in enumerate(runs.values(), start=1):
        place = _place(column)
        area = run.along("area", "m2")
        middle = area.shape[1] // 2
        for against in externals(run):
            symbol = "circle" if against == "skin" else "circle-open"
            pressure = transmural(run, against)[:, middle]
            figure.add_scatter(x=axes[0](pressure), y=axes[1](area[:, middle]), name=f"computed, against {against}",
                               mode="markers", marker={"color": QUIET, "symbol": symbol}, **place)  # fmt: skip
        range_of = np.linspace(area[:, middle].min(), area[:, middle].max(), 60)
        for colour, (name, fits) in zip(COLOURS, tube_laws(run, externals(run)[0]).items(), strict=False):
            _line(figure, axes, fits[middle].law.pressure(range_of), range_of, name, colour, **place)
    return figure


def one_dimension(comparisons: Mapping[str, Comparison]) -> go.Figure:
    """Return area, outflow and SAWSS over time in three dimensions (solid) and in one (dashed)."""
    axes = {"area": Shown("mean area", "mm2"), "flow": Shown("outflow", "ml_s"), "SAWSS": SAWSS}
    figure = _style(make_subplots(1, len(axes), horizontal_spacing=0.08)).update_xaxes(title=TIME.label)
    for column, (quantity, shown) in enumerate(axes.items(), start=1):
        figure.update_yaxes(title=shown.label, col=column)
        for (title, compared), colour in zip(comparisons.items(), COLOURS, strict=False):
            for what, values, dash in (("3-D", compared.three, "solid"), ("1-D", compared.one, "dash")):
                _line(figure, (TIME, shown), compared.solution.times, values[quantity], f"{title}, {what}", colour,
                      dash, **_place(column))  # fmt: skip
    return figure


def outlines(runs: Runs) -> go.Figure:
    """Return the outline of the lumen at mid-length, first (grey) and under the largest load, a panel per run."""
    figure, axes = _sections(runs)
    for column, (run, colour) in enumerate(zip(runs.values(), COLOURS, strict=False), start=1):
        for time, shade in ((0.0, QUIET), (run.loaded_time, colour)):
            found, rings = run.outlines(time)
            ring = middle(run).across(rings[len(rings) // 2])
            x, y = np.vstack([ring, ring[:1]]).T
            _line(figure, axes, x, y, _at(found), shade, row=1, col=column)
    return figure


def cut(runs: Runs) -> go.Figure:
    """Return the hydrostatic pressure of the solids in the deformed section at mid-length, under the largest load."""
    figure, axes = _sections(runs)
    images = [_section(run) for run in runs.values()]
    known = np.concatenate([pressure[np.isfinite(pressure)] for *_, pressure in images])
    low, high = map(float, np.percentile(known, [1, 99]) if len(known) else (0.0, 1.0))
    for column, (x, y, pressure) in enumerate(images, start=1):
        figure.add_heatmap(x=axes[0](x), y=axes[1](y), z=PRESSURE(pressure), colorscale=SCALE, zmin=PRESSURE(low),
                           zmax=PRESSURE(high), showscale=column == 1, colorbar={"title": symbol(PRESSURE.unit)},
                           hovertemplate=f"{_hover('z:.2f', PRESSURE)}<extra></extra>", row=1, col=column)  # fmt: skip
    return figure


def _section(run: StoredRun) -> tuple[Array, Array, Array]:
    """Return places [m] across the vessel and hydrostatic pressure [Pa] on a grid, NaN outside of the solids."""
    grid = solids(run, run.loaded_time)
    frame = Frame(np.zeros(3), np.eye(3)) if is_plane(grid) else course(run).frame(0.5 + OFF_FACES)
    flat = frame.across(np.asarray(grid.points, dtype=float))
    low, size = flat.min(axis=0), float(np.ptp(flat, axis=0).max()) / (CUT_POINTS - 1)
    x, y = (low[i] + size * np.arange(CUT_POINTS) for i in range(2))
    across = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    height = float(frame.centre @ frame.axes[2])
    sampled = pv.PolyData(across @ frame.axes[:2] + height * frame.axes[2]).sample(grid.triangulate())
    values = np.asarray(sampled.point_data["hydrostatic_pressure_Pa"], dtype=float)
    values[np.asarray(sampled.point_data["vtkValidPointMask"]) == 0] = np.nan
    return x, y, values.reshape(CUT_POINTS, CUT_POINTS)


def around(runs: Runs) -> go.Figure:
    """Return the hydrostatic pressure of the tissue at the vein's wall over the angle, first (dotted) and under the
    largest load."""
    axes = _angle(runs), Shown("pressure at the wall", "kPa")
    figure = _figure(*axes)
    for (title, run), colour in zip(runs.items(), COLOURS, strict=False):
        for time, dash in zip(first_and_loaded(run), ("dot", "solid"), strict=True):
            angle, pressure = Surroundings.of(run, time).by_angle()
            _line(figure, axes, angle, pressure, f"{title}, {_at(time)}", colour, dash, "lines+markers",
                  connectgaps=True)  # fmt: skip
    return figure


def unrolled(runs: Runs) -> go.Figure:
    """Return the wall shear stress under the largest load over the angle around and the position along the vein."""
    turned = _angle(runs)
    figure = _panels(list(runs), turned, POSITION, shared_yaxes=True)
    hover = f"{_hover('x:.0f', turned)}, {_hover('y:.1f', POSITION)}: {_hover('z:.4f', WSS)}<extra></extra>"
    for column, run in enumerate(runs.values(), start=1):
        angle, height, shear = unroll(run)
        figure.add_heatmap(x=turned(angle), y=POSITION(height), z=WSS(shear), coloraxis="coloraxis",
                           hovertemplate=hover, row=1, col=column)  # fmt: skip
    return figure.update_layout(coloraxis={"colorscale": SCALE, "colorbar": {"title": symbol(WSS.unit)}})


def vein(runs: Runs) -> go.Figure:
    """Return one run's deformed inner walls with their wall shear stress, to be turned, at up to seven times."""
    (run,) = runs.values()
    chosen = evenly(run.field_times("wall"), 7)
    walls = [run.fields(time, "wall").extract_surface(algorithm="dataset_surface") for time in chosen]
    high = float(np.percentile(walls[-1].point_data[SHEAR], 99))
    traces = [_surface(wall, SHEAR, WSS, high) for wall in walls]
    return _stages(traces, chosen, _camera(run, FROM_THE_SIDE, up=0))


def half(runs: Runs) -> go.Figure:
    """Return the lower half of one run's deformed solids, coloured by displacement, to be turned, first and under the
    largest load."""
    (run,) = runs.values()
    times = first_and_loaded(run)
    halves = [_skin_of(lower_half(run, time)) for time in times]
    high = float(halves[-1].point_data["displacement"].max())
    traces = [_surface(one, "displacement", MOVED, high) for one in halves]
    return _stages(traces, times, _camera(run, FROM_ABOVE, up=2))


def stability(runs: Runs) -> go.Figure:
    """Return the pressure at which each run's vein would collapse, as extrapolated at each stage, over the pressure on
    the skin (with the strongest cuff), and the smallest eigenvalue."""
    skin = Shown("pressure on the skin", "mmHg")
    axes = {"critical_skin_pressure_Pa": Shown("critical pressure on the skin", "mmHg"),
            "smallest_eigenvalue_1_s2": Shown("smallest eigenvalue", "1_s2")}  # fmt: skip
    figure = _style(make_subplots(1, 2, horizontal_spacing=0.12)).update_xaxes(title=skin.label)
    highest = 0.0
    for column, (name, shown) in enumerate(axes.items(), start=1):
        figure.update_yaxes(title=shown.label, col=column)
        for (title, run), colour in zip(runs.items(), COLOURS, strict=False):
            x, y = run.stability["skin_pressure_Pa"], run.stability[name]
            highest = max(highest, float(x.max()))
            _line(figure, (skin, shown), x, np.where(np.isfinite(y), y, np.nan), title, colour, mode="lines+markers",
                  legendgroup=title, showlegend=column == 2, row=1, col=column)  # fmt: skip
    _line(figure, (skin, skin), [0, highest], [0, highest], "collapse", QUIET, "dash", row=1, col=1)
    return figure


def softest(runs: Runs) -> go.Figure:
    """Return the stiffness of the softest motion of plane sections at each stage."""
    axes = TIME, Shown("stiffness over that of shear", "1")
    figure = _figure(*axes)
    for (title, run), colour in zip(runs.items(), COLOURS, strict=False):
        table = run.stability
        _line(figure, axes, table["time_s"], table["softest_stiffness_1"], title, colour, mode="lines+markers")
    return figure


def collapse(runs: Runs) -> go.Figure:
    """Return the lower half of one run's solids moved along the mode of collapse under the largest load, coloured by
    its size."""
    (run,) = runs.values()
    time = first_and_loaded(run)[1]
    moved = _skin_of(lower_half(run, time))
    if COLLAPSE not in moved.point_data:
        raise KeyError(COLLAPSE)
    mode = np.asarray(moved.point_data[COLLAPSE], dtype=float)
    size = np.linalg.norm(mode, axis=1)
    moved.points += (MODE_DRAWN * run.case.geometry.size / size.max() * mode).astype(moved.points.dtype)
    moved.point_data[RELATIVE.name] = size / size.max()
    return _stages([_surface(moved, RELATIVE.name, RELATIVE, 1.0)], [time], _camera(run, FROM_ABOVE, up=2))


def _skin_of(grid: Any) -> Any:
    return grid.extract_surface(nonlinear_subdivision=1, algorithm="dataset_surface")


def _camera(run: StoredRun, eye: Sequence[float], up: int) -> dict[str, Any]:
    """Return plotly's camera for a way to look, as components along the axes of the vessel's middle."""
    axes = middle(run).axes
    ways = {"eye": np.dot(eye, axes), "up": axes[up]}
    return {name: dict(zip("xyz", map(float, way), strict=True)) for name, way in ways.items()}


def _angle(runs: Runs) -> Shown:
    """Return the axis of angles."""
    start = course(next(iter(runs.values()))).start
    return Shown(f"angle from {start}{', lateral' if start == 'x' else ''}", "deg")


def _at(time: float) -> str:
    return f"t = {in_unit(time, TIME.unit, '.3g')}"


def _hover(value: str, shown: Shown) -> str:
    """Return what stands under the pointer for a value with its format, e.g. "z:.2f"."""
    return f"%{{{value}}} {symbol(shown.unit)}".rstrip()


def _sections(runs: Runs) -> tuple[go.Figure, tuple[Shown, Shown]]:
    """Return a panel of equal axes per run for what lies across its vessel, and the axes."""
    transverse = all(middle(run).is_transverse for run in runs.values())
    across = ("x, lateral", "y, anterior") if transverse else ("across the vein",) * 2
    axes = Shown(across[0], "mm"), Shown(across[1], "mm")
    figure = _panels(list(runs), *axes)
    for column in range(1, len(runs) + 1):
        figure.update_yaxes(scaleanchor=f"x{column if column > 1 else ''}", row=1, col=column)
    return figure, axes


def _surface(surface: Any, name: str, shown: Shown, high: float) -> go.Mesh3d:
    """Return a surface coloured by one of its fields from 0 to `high`."""
    triangles = surface.triangulate()
    x, y, z = (axis(part) for axis, part in zip(SPACE, np.asarray(triangles.points, dtype=np.float32).T, strict=True))
    i, j, k = np.asarray(triangles.regular_faces, dtype=np.int32).T
    values = np.asarray(shown(triangles.point_data[name]), dtype=np.float32)
    return go.Mesh3d(x=x, y=y, z=z, i=i, j=j, k=k, intensity=values,
                     colorscale=SCALE, cmin=0.0, cmax=shown(high), colorbar={"title": symbol(shown.unit) or "1"},
                     lighting={"ambient": 0.7, "diffuse": 0.4, "specular": 0.05},
                     hovertemplate=f"{_hover('intensity:.4g', shown)}<extra></extra>")  # fmt: skip


def _stages(traces: Sequence[go.Mesh3d], times: Sequence[float], camera: Mapping[str, Any]) -> go.Figure:
    """Return surfaces of which one is shown, the last at first, with a slider for the others."""
    for trace in traces:
        trace.visible = trace is traces[-1]
    steps = [
        {
            "method": "restyle",
            "label": in_unit(time, TIME.unit, ".3g"),
            "args": [{"visible": [n == m for m in range(len(traces))]}],
        }
        for n, time in enumerate(times)
    ]
    axes = {f"{axis.name}axis": {"title": axis.label} for axis in SPACE}
    extents = {name: float(np.ptp(traces[-1][name])) for name in "xyz"}
    ratio = {name: LONGEST * extent / max(extents.values()) for name, extent in extents.items()}
    return go.Figure(list(traces)).update_layout(
        scene={**axes, "aspectmode": "manual", "aspectratio": ratio, "camera": camera},
        sliders=[{"active": len(traces) - 1, "steps": steps, "currentvalue": {"prefix": "t = "}}],
        height=560, margin={"l": 20, "r": 20, "t": 10, "b": 40},
    )  # fmt: skip


def _line(
    figure: go.Figure, axes: tuple[Shown, Shown], x: Any, y: Any, name: str, colour: str, dash: str = "solid",
    mode: str = "lines", **more: Any,
) -> None:  # fmt: skip
    """Draw a line of SI values."""
    x, y = (axis(np.asarray(values)) for axis, values in zip(axes, (x, y), strict=True))
    figure.add_scatter(x=x, y=y, name=name, mode=mode, line={"color": colour, "dash": dash}, **more)


def _place(column: int) -> dict[str, Any]:
    """Return where a line is drawn, whose legend is that of the first panel."""
    return {"row": 1, "col": column, "showlegend": column == 1}


def _figure(x: Shown, y: Shown) -> go.Figure:
    return _style(go.Figure()).update_layout(xaxis_title=x.label, yaxis_title=y.label)


def _panels(titles: list[str], x: Shown, y: Shown, **options: Any) -> go.Figure:
    figure = _style(make_subplots(1, len(titles), subplot_titles=titles, **options))
    figure.update_xaxes(title=x.label)
    return figure.update_yaxes(title=y.label, col=1)


def _style(figure: go.Figure) -> go.Figure:
    margin, legend = {"l": 60, "r": 20, "t": 40, "b": 50}, {"orientation": "h", "y": -0.2}
    return figure.update_layout(template="simple_white", height=420, margin=margin, legend=legend)
