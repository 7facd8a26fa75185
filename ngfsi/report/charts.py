"""Interactive charts of stored runs (plotly): each function returns a figure, values under the pointer, units on all
axes."""

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
    OFF_FACES,
    SHEAR,
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
from ngfsi.store.vessels import Frame
from ngfsi.units import MMHG

Runs = Mapping[str, StoredRun]
"""Title -> run, in the order of their colours."""

SCALE = "Viridis"
"""Of the colours of fields: even steps of brightness, for colour-blind readers too."""
LONGEST = 1.9
"""Longest side of a scene, in plotly's units."""
CUT_POINTS = 181
"""Points across a cut."""
MODE_DRAWN = 0.4
"""Largest motion of a mode that is drawn, over the size of the geometry: of a vein, the lumen's radius."""


def over_time(
    runs: Runs, quantities: Mapping[str, Callable[[StoredRun], Array]], label: str, *, dashed: Sequence[str] = ()
) -> go.Figure:
    """Return quantities over time, a colour per run and a line per quantity.

    Args:
        quantities: name -> values at the times of a run's series.
        dashed: names of those drawn dashed.
    """
    figure = _figure("time [s]", label)
    for (title, run), colour in zip(runs.items(), COLOURS, strict=False):
        for name, values in quantities.items():
            text = f"{title}: {name}" if len(quantities) > 1 else title
            _line(figure, run.series["time_s"], values(run), text, colour, "dash" if name in dashed else "solid")
    return figure


def causes(runs: Runs) -> go.Figure:
    """Return the rise of SAWSS by cause over time, stacked, a panel per run."""
    figure = _panels(list(runs), "time [s]", "SAWSS [Pa]", shared_yaxes=True)
    for column, run in enumerate(runs.values(), start=1):
        times, place = run.series["time_s"], _place(column)
        for colour, (cause, values) in zip([QUIET, *COLOURS], decompose(run.series).items(), strict=False):
            figure.add_bar(x=times, y=values, name=cause, marker_color=colour, legendgroup=cause, **place)
        _line(figure, times, run.series["sawss_Pa"], "computed", "black", legendgroup="computed", **place)
    return figure.update_layout(barmode="relative", bargap=0)


def along_vein(runs: Runs, name: str, unit: str, factor: float, label: str) -> go.Figure:
    """Return a quantity that the series hold for each station, over the position along the vessel: first (dotted) and
    under the largest load."""
    figure = _figure("position along the vein [mm]", label)
    for (title, run), colour in zip(runs.items(), COLOURS, strict=False):
        values = factor * run.along(name, unit)
        positions = np.linspace(0, course(run).length * 1e3, values.shape[1])
        for row, dash in ((0, "dot"), (run.series["time_s"].searchsorted(run.loaded_time), "solid")):
            text = f"{title}, t = {run.series['time_s'][row]:.3g} s"
            _line(figure, positions, values[row], text, colour, dash, "lines+markers")
    return figure


def tube_law(runs: Runs) -> go.Figure:
    """Return the area at mid-length over the transmural pressure against the skin (filled) and against the tissue's
    traction on the wall (hollow), with the laws fitted to the first there is, a panel per run."""
    figure = _panels(list(runs), "transmural pressure [kPa]", "area at mid-length [mm²]", shared_yaxes=True)
    for column, run in enumerate(runs.values(), start=1):
        place = _place(column)
        area = run.along("area", "m2")
        middle = area.shape[1] // 2
        for against in externals(run):
            symbol = "circle" if against == "skin" else "circle-open"
            pressure = transmural(run, against)[:, middle]
            figure.add_scatter(x=pressure / 1e3, y=area[:, middle] * 1e6, name=f"computed, against {against}",
                               mode="markers", marker={"color": QUIET, "symbol": symbol}, **place)  # fmt: skip
        range_of = np.linspace(area[:, middle].min(), area[:, middle].max(), 60)
        for colour, (name, fits) in zip(COLOURS, tube_laws(run, externals(run)[0]).items(), strict=False):
            pressure = fits[middle].law.pressure(range_of)
            _line(figure, pressure / 1e3, range_of * 1e6, name, colour, **place)
    return figure


def one_dimension(comparisons: Mapping[str, Comparison]) -> go.Figure:
    """Return area, outflow and SAWSS over time in three dimensions (solid) and in one (dashed)."""
    units = {"area": ("mean area [mm²]", 1e6), "flow": ("outflow [ml/s]", 1e6), "SAWSS": ("SAWSS [Pa]", 1.0)}
    figure = _style(make_subplots(1, len(units), horizontal_spacing=0.08)).update_xaxes(title="time [s]")
    for column, (quantity, (label, factor)) in enumerate(units.items(), start=1):
        figure.update_yaxes(title=label, col=column)
        for (title, compared), colour in zip(comparisons.items(), COLOURS, strict=False):
            for what, values, dash in (("3-D", compared.three, "solid"), ("1-D", compared.one, "dash")):
                _line(figure, compared.solution.times, factor * values[quantity], f"{title}, {what}", colour, dash,
                      **_place(column))  # fmt: skip
    return figure


def outlines(runs: Runs) -> go.Figure:
    """Return the outline of the lumen at mid-length, first (grey) and under the largest load, a panel per run."""
    figure = _sections(runs)
    for column, (run, colour) in enumerate(zip(runs.values(), COLOURS, strict=False), start=1):
        for time, shade in ((0.0, QUIET), (run.loaded_time, colour)):
            found, rings = run.outlines(time)
            ring = middle(run).across(rings[len(rings) // 2]) * 1e3
            x, y = np.vstack([ring, ring[:1]]).T
            _line(figure, x, y, f"t = {found:.3g} s", shade, row=1, col=column)
    return figure


def cut(runs: Runs) -> go.Figure:
    """Return the hydrostatic pressure of the solids in the deformed section at mid-length, under the largest load."""
    figure = _sections(runs)
    images = [_section(run) for run in runs.values()]
    known = np.concatenate([pressure[np.isfinite(pressure)] for *_, pressure in images])
    low, high = np.percentile(known, [1, 99]) if len(known) else (0.0, 1.0)
    for column, (x, y, pressure) in enumerate(images, start=1):
        figure.add_heatmap(x=x, y=y, z=pressure, colorscale=SCALE, zmin=low, zmax=high, showscale=column == 1,
                           colorbar={"title": "kPa"}, hovertemplate="%{z:.2f} kPa<extra></extra>", row=1,
                           col=column)  # fmt: skip
    return figure


def _section(run: StoredRun) -> tuple[Array, Array, Array]:
    """Return places [mm] across the vessel and hydrostatic pressure [kPa] on a grid, NaN outside of the solids."""
    grid = solids(run, run.loaded_time)
    frame = Frame(np.zeros(3), np.eye(3)) if is_plane(grid) else course(run).frame(0.5 + OFF_FACES)
    flat = frame.across(np.asarray(grid.points, dtype=float))
    low, size = flat.min(axis=0), float(np.ptp(flat, axis=0).max()) / (CUT_POINTS - 1)
    x, y = (low[i] + size * np.arange(CUT_POINTS) for i in range(2))
    across = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    height = float(frame.centre @ frame.axes[2])
    sampled = pv.PolyData(across @ frame.axes[:2] + height * frame.axes[2]).sample(grid.triangulate())
    values = np.asarray(sampled.point_data["hydrostatic_pressure_Pa"], dtype=float) / 1e3
    values[np.asarray(sampled.point_data["vtkValidPointMask"]) == 0] = np.nan
    return 1e3 * x, 1e3 * y, values.reshape(CUT_POINTS, CUT_POINTS)


def around(runs: Runs) -> go.Figure:
    """Return the hydrostatic pressure of the tissue at the vein's wall over the angle, first (dotted) and under the
    largest load."""
    figure = _figure(_angle(runs), "pressure at the wall [kPa]")
    for (title, run), colour in zip(runs.items(), COLOURS, strict=False):
        for time, dash in zip(first_and_loaded(run), ("dot", "solid"), strict=True):
            angle, pressure = Surroundings.of(run, time).by_angle()
            _line(figure, np.degrees(angle), pressure / 1e3, f"{title}, t = {time:.3g} s", colour, dash,
                  "lines+markers", connectgaps=True)  # fmt: skip
    return figure


def unrolled(runs: Runs) -> go.Figure:
    """Return the wall shear stress under the largest load over the angle around and the position along the vein."""
    figure = _panels(list(runs), _angle(runs), "position along the vein [mm]", shared_yaxes=True)
    for column, run in enumerate(runs.values(), start=1):
        angle, height, shear = unroll(run)
        figure.add_heatmap(x=angle, y=height, z=shear, coloraxis="coloraxis",
                           hovertemplate="%{x:.0f} deg, %{y:.1f} mm: %{z:.4f} Pa<extra></extra>", row=1,
                           col=column)  # fmt: skip
    return figure.update_layout(coloraxis={"colorscale": SCALE, "colorbar": {"title": "Pa"}})


def vein(runs: Runs) -> go.Figure:
    """Return one run's deformed inner walls with their wall shear stress, to be turned, at up to seven times."""
    (run,) = runs.values()
    chosen = evenly(run.field_times("wall"), 7)
    walls = [run.fields(time, "wall") for time in chosen]
    high = float(np.percentile(walls[-1].point_data[SHEAR], 99))
    traces = [
        _surface(wall.extract_surface(algorithm="dataset_surface"), wall.point_data[SHEAR], "Pa", (0.0, high))
        for wall in walls
    ]
    return _stages(traces, [f"{time:.3g} s" for time in chosen], _camera(run, FROM_THE_SIDE, up=0))


def half(runs: Runs) -> go.Figure:
    """Return the lower half of one run's deformed solids, coloured by displacement, to be turned, first and under the
    largest load."""
    (run,) = runs.values()
    times = first_and_loaded(run)
    halves = [_skin_of(lower_half(run, time)) for time in times]
    high = float(halves[-1].point_data["displacement"].max())
    traces = [_surface(one, one.point_data["displacement"], "mm", (0.0, high)) for one in halves]
    return _stages(traces, [f"{time:.3g} s" for time in times], _camera(run, FROM_ABOVE, up=2))


def stability(runs: Runs) -> go.Figure:
    """Return the pressure at which each run's vein would collapse, as extrapolated at each stage, over the pressure on
    the skin (with the strongest cuff), and the smallest eigenvalue."""
    figure = _style(make_subplots(1, 2, horizontal_spacing=0.12)).update_xaxes(title="pressure on the skin [mmHg]")
    figure.update_yaxes(title="critical pressure on the skin [mmHg]", col=1)
    figure.update_yaxes(title="smallest eigenvalue [1/s²]", col=2)
    highest = 0.0
    for (title, run), colour in zip(runs.items(), COLOURS, strict=False):
        table = run.stability
        skin, critical = (table[name] / MMHG for name in ("skin_pressure_Pa", "critical_skin_pressure_Pa"))
        critical = np.where(np.isfinite(critical), critical, np.nan)
        highest = max(highest, float(skin.max()))
        for column, values in ((1, critical), (2, table["smallest_eigenvalue_1_s2"])):
            _line(figure, skin, values, title, colour, mode="lines+markers", legendgroup=title,
                  showlegend=column == 2, row=1, col=column)  # fmt: skip
    _line(figure, [0, highest], [0, highest], "collapse", QUIET, "dash", row=1, col=1)
    return figure


def softest(runs: Runs) -> go.Figure:
    """Return the stiffness of the softest motion of plane sections at each stage."""
    figure = _figure("time [s]", "stiffness over that of shear [1]")
    for (title, run), colour in zip(runs.items(), COLOURS, strict=False):
        table = run.stability
        _line(figure, table["time_s"], table["softest_stiffness_1"], title, colour, mode="lines+markers")
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
    shown = _surface(moved, size / size.max(), "1", (0.0, 1.0))
    return _stages([shown], [f"{time:.3g} s"], _camera(run, FROM_ABOVE, up=2))


def _skin_of(grid: Any) -> Any:
    return grid.extract_surface(nonlinear_subdivision=1, algorithm="dataset_surface")


def _camera(run: StoredRun, eye: Sequence[float], up: int) -> dict[str, Any]:
    """Return plotly's camera for a way to look, as components along the axes of the vessel's middle."""
    axes = middle(run).axes
    ways = {"eye": np.dot(eye, axes), "up": axes[up]}
    return {name: dict(zip("xyz", map(float, way), strict=True)) for name, way in ways.items()}


def _angle(runs: Runs) -> str:
    """Return the title of an axis of angles."""
    start = course(next(iter(runs.values()))).start
    return f"angle from {start}{', lateral' if start == 'x' else ''} [deg]"


def _sections(runs: Runs) -> go.Figure:
    """Return a panel of equal axes per run for what lies across its vessel."""
    transverse = all(middle(run).is_transverse for run in runs.values())
    labels = ("x, lateral [mm]", "y, anterior [mm]") if transverse else ("across the vein [mm]",) * 2
    figure = _panels(list(runs), *labels)
    for column in range(1, len(runs) + 1):
        figure.update_yaxes(scaleanchor=f"x{column if column > 1 else ''}", row=1, col=column)
    return figure


def _surface(surface: Any, values: Any, unit: str, limits: tuple[float, float]) -> go.Mesh3d:
    """Return a coloured surface in mm."""
    triangles = surface.triangulate()
    x, y, z = np.asarray(triangles.points, dtype=np.float32).T * 1e3
    i, j, k = np.asarray(triangles.regular_faces, dtype=np.int32).T
    shown = np.asarray(values, dtype=np.float32)
    return go.Mesh3d(x=x, y=y, z=z, i=i, j=j, k=k, intensity=shown, colorscale=SCALE, cmin=limits[0], cmax=limits[1],
                     colorbar={"title": unit}, lighting={"ambient": 0.7, "diffuse": 0.4, "specular": 0.05},
                     hovertemplate=f"%{{intensity:.4g}} {unit}<extra></extra>")  # fmt: skip


def _stages(traces: Sequence[go.Mesh3d], labels: Sequence[str], camera: Mapping[str, Any]) -> go.Figure:
    """Return surfaces of which one is shown, the last at first, with a slider for the others."""
    for trace in traces:
        trace.visible = trace is traces[-1]
    steps = [
        {"method": "restyle", "label": label, "args": [{"visible": [n == m for m in range(len(traces))]}]}
        for n, label in enumerate(labels)
    ]
    axes = {f"{name}axis": {"title": f"{name} [mm]"} for name in "xyz"}
    extents = {name: float(np.ptp(traces[-1][name])) for name in "xyz"}
    ratio = {name: LONGEST * extent / max(extents.values()) for name, extent in extents.items()}
    return go.Figure(list(traces)).update_layout(
        scene={**axes, "aspectmode": "manual", "aspectratio": ratio, "camera": camera},
        sliders=[{"active": len(traces) - 1, "steps": steps, "currentvalue": {"prefix": "t = "}}],
        height=560, margin={"l": 20, "r": 20, "t": 10, "b": 40},
    )  # fmt: skip


def _line(
    figure: go.Figure, x: Any, y: Any, name: str, colour: str, dash: str = "solid", mode: str = "lines", **more: Any
) -> None:
    figure.add_scatter(x=x, y=y, name=name, mode=mode, line={"color": colour, "dash": dash}, **more)


def _place(column: int) -> dict[str, Any]:
    """Return where a line is drawn, whose legend is that of the first panel."""
    return {"row": 1, "col": column, "showlegend": column == 1}


def _figure(x: str, y: str) -> go.Figure:
    return _style(go.Figure()).update_layout(xaxis_title=x, yaxis_title=y)


def _panels(titles: list[str], x: str, y: str, **options: Any) -> go.Figure:
    figure = _style(make_subplots(1, len(titles), subplot_titles=titles, **options))
    figure.update_xaxes(title=x)
    return figure.update_yaxes(title=y, col=1)


def _style(figure: go.Figure) -> go.Figure:
    margin, legend = {"l": 60, "r": 20, "t": 40, "b": 50}, {"orientation": "h", "y": -0.2}
    return figure.update_layout(template="simple_white", height=420, margin=margin, legend=legend)
