"""What is printed and drawn is read back from what was written, and held against the stored numbers in its unit.

The run has no two equal columns, a vein whose outlines taper, and its largest load in the middle of its time, so that
no number can stand for another. Units are those of a table of its own.
"""

from __future__ import annotations

import ast
import base64
import json
import math
import re
import tomllib
from collections.abc import Callable, Mapping
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_studies import figures as of_studies
from rich.console import Console
from scipy.spatial import KDTree

import ngfsi.report
from ngfsi.analysis.tube import in_one_dimension, overall_error, tube_laws
from ngfsi.materials import available_sets, read_set
from ngfsi.report import figures, terminal
from ngfsi.report.html import CHARTS, HEADLINE, report
from ngfsi.report.tables import error_rows
from ngfsi.store.stored import StoredRun, open_run
from ngfsi.store.table import write_rows
from ngfsi.units import Shown
from tests.output.fake import CASE, GEOMETRY, INFLATION, fake_run

UNITS = {
    "kPa": 1e3, "Pa": 1.0, "mmHg": 133.322, "mm": 1e-3, "m": 1.0, "mm²": 1e-6, "m²": 1.0, "m³": 1.0, "m³/s": 1.0,
    "ml/s": 1e-6, "%": 1e-2, "s": 1.0, "deg": math.pi / 180, "1": 1.0, "1/s²": 1.0, "kg/m³": 1.0, "mPa s": 1e-3,
}  # fmt: skip
MMHG, LOADED = 133.322, 4
"""Row of the largest load."""
(X0, Y0), RADIUS, LENGTH = GEOMETRY.vein_centre, GEOMETRY.lumen_radius, GEOMETRY.length
CLAIMS = {
    "citation": "a book", "volume_reduction_percent": {"M": 30.5}, "sawss_rise_percent": {"M": 205.0},
    "hydrostatic_pressure_kPa": {"M": 5.83},
}  # fmt: skip
ERRORS: list[dict[str, float | str]] = [
    {"quantity": "loss of volume", "value": 0.24683, "unit": "1", "space_end_1": 0.0123, "space_largest_1": 0.0231,
     "time_end_1": 0.00345, "time_largest_1": 0.00456},
    {"quantity": "SAWSS", "value": 0.13579, "unit": "Pa", "space_end_1": 0.000567, "space_largest_1": 0.00678,
     "time_end_1": 0.0789, "time_largest_1": 0.0891},
]  # fmt: skip
SHOWN_ERRORS = [
    ["quantity", "at the end", "from space, at the end %", "from space, largest %", "from time, at the end %",
     "from time, largest %"],
    ["loss of volume", "24.68 %", "1.2", "2.3", "0.34", "0.46"],
    ["SAWSS", "0.1358 Pa", "0.057", "0.68", "7.9", "8.9"],
]  # fmt: skip
Table = Mapping[str, np.ndarray]


def read(path: Path) -> Table:
    rows = np.genfromtxt(path, delimiter=",", names=True, deletechars="")
    return {name: rows[name] for name in rows.dtype.names}


def write(path: Path, table: Table) -> None:
    np.savetxt(path, np.column_stack(list(table.values())), "%.17g", ",", header=",".join(table), comments="")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> StoredRun:
    folder = tmp_path_factory.mktemp("shown") / "run"
    fake_run(folder, CASE.replace(name="odd"), collapse_mode_1=ng.CF((ng.z, 0, 0)))
    series = dict(read(folder / "series.csv"))
    times = series["time_s"]
    series |= {name: np.ones_like(times) for name in ("lumen_area_m2", "skin_area_m2")}
    series |= {f"flow_z{station:02d}_m3_s": np.ones_like(times) for station in range(11)}
    for number, name in enumerate(series):
        if name != "time_s":
            series[name] = series[name] * (1 + 1e-3 * number) * (1 + 1e-2 * np.cos(1.0 + times * (1 + number % 7)))
        if name.endswith("_m3_s"):
            series[name] = 3e-6 * (1 + 0.1 * (number % 5)) * series[name]
        if name.endswith("_m") or name.endswith("area_1"):
            series[name] = 0.2 * series[name]
        if name.startswith("skin_pressure"):
            series[name][LOADED + 1 :] *= 0.9
        assert len(np.unique(series[name])) >= len(times) - 1, name
    series["displacement_max_m"] = 1e-2 * series["displacement_max_m"]
    write(folder / "series.csv", series)
    rings = dict(read(folder / "outlines.csv"))
    for name, centre in (("x_m", X0), ("y_m", Y0)):
        rings[name] = centre + (1 + 0.03 * rings["station"]) * (rings[name] - centre)
    write(folder / "outlines.csv", rings)
    write(folder / "stability.csv", {
        "time_s": np.array([0.0, 0.5, 1.0]), "skin_pressure_Pa": np.array([0.0, 1500.0, 3100.0]),
        "critical_skin_pressure_Pa": np.array([np.nan, 9100.0, 8200.0]),
        "smallest_eigenvalue_1_s2": np.array([900.0, 700.0, 350.0]),
        "softest_stiffness_1": np.array([0.9, 0.7, 0.4]),
    })  # fmt: skip
    write_rows(folder / "errors.csv", ERRORS)
    return open_run(folder)


@pytest.fixture(scope="module")
def series(run: StoredRun) -> Table:
    return read(run.path / "series.csv")


@pytest.fixture(scope="module")
def sections(run: StoredRun) -> dict[str, list[Any]]:
    """Heading -> its charts (traces, layout), tables (lists of rows) and texts, as written to the page."""
    text = report([run.path], run.path.parent / "report.html", CLAIMS).read_text(encoding="utf-8")
    found: dict[str, list[Any]] = {}
    for part in text.split("<h2>")[1:]:
        heading, _, rest = part.partition("</h2>")
        page = Page()
        page.feed(re.sub(r"<script.*?</script>", lambda script: chart_marks(script[0]), rest, flags=re.S))
        found[heading] = page.parts
    return found


def chart_marks(script: str) -> str:
    if "Plotly.newPlot(" not in script:
        return ""
    return f"<plot>{base64.b64encode(script.encode()).decode()}</plot>"


def chart_of(script: str) -> tuple[list[Any], Any]:
    rest, decoder, parts = script[script.index("Plotly.newPlot(") :].partition("(")[2], json.JSONDecoder(), []
    for _ in range(3):
        part, end = decoder.raw_decode(rest.lstrip(" ,\n"))
        parts.append(part)
        rest = rest.lstrip(" ,\n")[end:]
    return parts[1], parts[2]


class Page(HTMLParser):
    """Tables, texts and charts of a section, in their order."""

    def __init__(self) -> None:
        super().__init__()
        self.parts: list[Any] = []
        self._open: list[str] | None = None

    def handle_starttag(self, tag: str, _: Any) -> None:
        if tag == "table":
            self.parts.append([])
        elif tag == "tr":
            self.parts[-1].append([])
        if tag in ("td", "th", "p", "li", "plot"):
            self._open = []

    def handle_data(self, data: str) -> None:
        if self._open is not None:
            self._open.append(data)

    def handle_endtag(self, tag: str) -> None:
        if tag not in ("td", "th", "p", "li", "plot") or self._open is None:
            return
        text, self._open = "".join(self._open), None
        if tag in ("td", "th"):
            self.parts[-1][-1].append(text)
        else:
            self.parts.append(chart_of(base64.b64decode(text).decode()) if tag == "plot" else text)


def numbers(values: Any) -> np.ndarray:
    """Return the values of a trace, which plotly writes as lists or as bytes."""
    if isinstance(values, dict):
        kind = {"f8": "f8", "f4": "f4", "i4": "i4", "i2": "i2", "i1": "i1", "u1": "u1", "u2": "u2"}[values["dtype"]]
        shape = [int(n) for n in str(values.get("shape", "-1")).split(",")]
        return np.frombuffer(base64.b64decode(values["bdata"]), kind).reshape(shape).astype(float)
    return np.array(values, dtype=float)


def axis_of(layout: Any, trace: Any, name: str) -> tuple[str, float]:
    """Return what is written at an axis of a trace, without the unit, and the unit's size."""
    own = trace.get(f"{name}axis", name).replace(name, f"{name}axis", 1)
    title = layout[own]["title"]["text"]
    words, unit = re.fullmatch(r"(.*) \[(.*)\]", title).groups()  # type: ignore[union-attr]
    return words, UNITS[unit.removesuffix(" of t = 0")]


Curve = tuple[str, str, Any, str, Any]
"""Name of a trace, words and SI values along x and y."""


def check(chart: tuple[list[Any], Any], curves: list[Curve], tolerance: float = 1e-9) -> None:
    traces, layout = chart
    assert [trace.get("name") for trace in traces] == [curve[0] for curve in curves]
    for trace, (name, *sides) in zip(traces, curves, strict=True):
        for axis, words, expected in (("x", *sides[:2]), ("y", *sides[2:])):
            written, unit = axis_of(layout, trace, axis)
            assert written == words, name
            np.testing.assert_allclose(unit * numbers(trace[axis]), expected, rtol=tolerance, err_msg=name)


def over_time(series: Table, words: str, **columns: str) -> list[Curve]:
    lines = {name.replace("_", " "): series[column] for name, column in columns.items()}
    return [
        (f"odd: {name}" if len(lines) > 1 else "odd", "time", series["time_s"], words, values)
        for name, values in lines.items()
    ]


def share(series: Table, words: str, column: str) -> list[Curve]:
    return [("odd", "time", series["time_s"], words, series[column] / series[column][0])]


def along(series: Table, words: str, name: str, unit: str) -> list[Curve]:
    rows = [(0, "odd, t = 0 s"), (LOADED, "odd, t = 1 s")]
    at = [series[f"{name}_z{station:02d}_{unit}"] for station in range(11)]
    places = np.linspace(0, LENGTH, 11)
    return [(title, "position along the vein", places, words, np.array(at)[:, row]) for row, title in rows]


def causes(series: Table) -> list[Curve]:
    inlet, local, ellipse, sawss = (
        series[f"sawss{name}_Pa"] for name in ("_poiseuille_inlet", "_poiseuille_local", "_ellipse_local", "")
    )
    parts = {"at t = 0": 0 * sawss + sawss[0]}
    for name, step in (("narrowing", inlet), ("squeeze flow", local - inlet), ("shape", ellipse - local),
                       ("profile", sawss - ellipse)):  # fmt: skip
        parts[name] = step - step[0]
    return [(name, "time", series["time_s"], "SAWSS", values) for name, values in (*parts.items(), ("computed", sawss))]


def outline(run: StoredRun) -> list[Curve]:
    table = read(run.path / "outlines.csv")
    found: list[Curve] = []
    for time in (0.0, 1.0):
        at = (table["time_s"] == time) & (table["station"] == 5)
        x, y = (np.append(table[name][at], table[name][at][0]) for name in ("x_m", "y_m"))
        found.append((f"t = {time:g} s", "x, lateral", x, "y, anterior", y))
    return found


def stability(run: StoredRun) -> list[Curve]:
    table = read(run.path / "stability.csv")
    skin, words = table["skin_pressure_Pa"], ("critical pressure on the skin", "smallest eigenvalue")
    columns = "critical_skin_pressure_Pa", "smallest_eigenvalue_1_s2"
    lines = [
        ("odd", "pressure on the skin", skin, word, table[name]) for word, name in zip(words, columns, strict=True)
    ]
    ends = [0.0, skin.max()]
    return [*lines, ("collapse", "pressure on the skin", ends, words[0], ends)]


def tube_curves(run: StoredRun, series: Table) -> list[Curve]:
    area, blood, skin = (series[name] for name in ("area_z05_m2", "p_blood_z05_Pa", "skin_pressure_Pa"))
    sides = "transmural pressure", "area at mid-length"
    sizes = np.linspace(area.min(), area.max(), 60)
    return [
        ("computed, against skin", sides[0], blood - skin, sides[1], area),
        ("computed, against tissue", sides[0], series["p_transmural_z05_Pa"], sides[1], area),
        *((name, sides[0], fits[5].law.pressure(sizes), sides[1], sizes)
          for name, fits in tube_laws(run, "skin").items()),
    ]  # fmt: skip


CURVES: dict[str, Callable[[StoredRun, Table], list[Curve]]] = {
    "Area of the lumen": lambda _, s: share(s, "mean area", "lumen_area_mean_m2"),
    "Volume of the lumen": lambda _, s: share(s, "volume", "lumen_volume_m3"),
    "Area of the lumen in the section": lambda _, s: share(s, "area", "lumen_area_m2"),
    "Area inside the skin": lambda _, s: share(s, "area", "skin_area_m2"),
    "Largest displacement": lambda _, s: over_time(s, "displacement", displacement="displacement_max_m"),
    "Wall shear stress": lambda _, s: over_time(s, "SAWSS", computed="sawss_Pa",
                                                developed_flow="sawss_poiseuille_local_Pa"),
    "Wall shear stress, mean": lambda _, s: over_time(s, "SAWSS", computed="sawss_Pa"),
    "Why it rises": lambda _, s: causes(s),
    "Along the vein: area": lambda _, s: along(s, "lumen area", "area", "m2"),
    "Along the vein: wall shear stress": lambda _, s: along(s, "WSS, mean around", "wss", "Pa"),
    "Along the vein: flow": lambda _, s: along(s, "flow", "flow", "m3_s"),
    "Outline of the lumen at mid-length": lambda r, _: outline(r),
    "Flow balance": lambda _, s: over_time(s, "flow", inflow="flow_in_m3_s", outflow="flow_out_m3_s",
                                           rate_of_volume="lumen_volume_rate_m3_s"),
    "Pressure around the vein": lambda _, s: over_time(s, "pressure", tissue_side="p_tissue_side_Pa",
                                                       skin="skin_pressure_mean_Pa"),
    "Stability": lambda r, _: stability(r),
    "Stiffness of the softest motion": lambda r, _: [
        ("odd", "time", (table := read(r.path / "stability.csv"))["time_s"], "stiffness over that of shear",
         table["softest_stiffness_1"])],
    "Along the vein: transmural pressure": lambda _, s: along(s, "transmural pressure", "p_transmural", "Pa"),
    "Tube law": tube_curves,
}  # fmt: skip
"""Chart of lines -> its curves."""


@pytest.mark.parametrize("title", CURVES)
def test_lines(run: StoredRun, series: Table, sections: dict[str, list[Any]], title: str) -> None:
    if title in sections:
        drawn = sections[title][0]
    else:  # of other models
        (chart,) = (chart for chart in CHARTS if chart.title == title)
        figure = json.loads(chart.make({"odd": run}).to_json())
        drawn = figure["data"], figure["layout"]
    check(drawn, CURVES[title](run, series))


def test_in_one_dimension(run: StoredRun, series: Table, sections: dict[str, list[Any]]) -> None:
    drawn, table, _ = sections["In one dimension"]
    columns = {"mean area": "lumen_area_mean_m2", "outflow": "flow_out_m3_s", "SAWSS": "sawss_Pa"}
    found = in_one_dimension(run)
    curves: list[Curve] = []
    for (words, column), values in zip(columns.items(), found.one.values(), strict=True):
        curves.append(("odd, 3-D", "time", series["time_s"], words, series[column]))
        curves.append(("odd, 1-D", "time", series["time_s"], words, values))
    check(drawn, curves)
    assert table[0] == ["run, 1-D against 3-D", *(f"{name}: mean, rms %" for name in ("area", "flow", "SAWSS"))]
    wanted = [f"{100 * gap.mean:+.2f}, {100 * gap.rms:.2f}" for gap in found.gaps.values()]
    assert table[1:] == [["odd", *wanted]]
    assert len(set(wanted)) == 3


def stretch(time: float) -> float:
    return math.sqrt(INFLATION * (1 - 0.25 * min(time, 1.0)))


def surfaces(sections: dict[str, list[Any]], title: str, words: str) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Return time, points (n, 3) [m] and SI values of each stage of a chart in space."""
    traces, layout = sections[title][0]
    found = []
    labels = [step["label"] for step in layout["sliders"][0]["steps"]]
    for label, trace in zip(labels, traces, strict=True):
        unit = trace["colorbar"]["title"]["text"]
        shown = f" {unit}" if unit != "1" else ""
        assert trace["hovertemplate"] == f"%{{intensity:.4g}}{shown}<extra></extra>", words
        scene = [layout["scene"][f"{name}axis"]["title"]["text"] for name in "xyz"]
        assert scene == ["x [mm]", "y [mm]", "z [mm]"]
        points = 1e-3 * np.column_stack([numbers(trace[name]) for name in "xyz"])
        values = UNITS[unit] * numbers(trace["intensity"])
        found.append((float(label.removesuffix(" s")), points, values))
    highest = np.percentile(values, 99 if unit == "Pa" else 100)
    for trace in traces:
        assert (trace["cmin"], UNITS[unit] * trace["cmax"]) == (0, pytest.approx(highest, rel=1e-2))
    return found


def test_vein_in_3d(sections: dict[str, list[Any]]) -> None:
    stages = surfaces(sections, "Vein in 3-D: odd", "wall shear stress")
    assert [time for time, *_ in stages] == [0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5]
    for time, points, values in stages:
        wanted = 0.08 / stretch(time) ** 3 * (1 + 0.3 * points[:, 2] / LENGTH)
        np.testing.assert_allclose(values, wanted, rtol=1e-5)
        away = np.hypot(points[:, 0] - X0, points[:, 1] - Y0)
        np.testing.assert_allclose(away, RADIUS * stretch(time), rtol=1e-5)


def test_solids_in_3d(run: StoredRun, sections: dict[str, list[Any]]) -> None:
    """The stored displacement, at the nodes that the surface has of the mesh."""
    stages = surfaces(sections, "Solids in 3-D: odd", "displacement")
    assert [time for time, *_ in stages] == [0.0, 1.5]
    for time, points, values in stages:
        grid = run.fields(time)
        away, nearest = KDTree(grid.points).query(points)
        nodes = away < 1e-7
        assert nodes.mean() > 0.3
        sizes = np.linalg.norm(grid.point_data["displacement_m"][nearest[nodes]], axis=1)
        np.testing.assert_allclose(values[nodes], sizes, rtol=1e-4, atol=1e-9)
        assert np.ptp(sizes) > 1e-4
        assert points[:, 2].max() == pytest.approx(LENGTH / 2, rel=0.05)


def test_mode_of_collapse(run: StoredRun, sections: dict[str, list[Any]]) -> None:
    """Along x in proportion to z: its largest motion is 0.4 of the vein's radius."""
    ((time, points, values),) = surfaces(sections, "Mode of collapse: odd", "relative size")
    assert (time, values.max()) == (1.5, 1.0)
    np.testing.assert_allclose(values, points[:, 2] / points[:, 2].max(), atol=1e-5)
    solids = surfaces(sections, "Solids in 3-D: odd", "displacement")[-1][1]
    moved = (points[:, 0] - solids[:, 0]) / values.clip(1e-6)
    assert np.median(moved) == pytest.approx(0.4 * run.case.geometry.size, rel=1e-4)


def test_the_unrolled_wall(sections: dict[str, list[Any]]) -> None:
    """At each point of the stored wall the colour is its stress."""
    (trace,), layout = sections["Wall shear stress on the unrolled vein"][0]
    (turned, degree), (along, length) = (axis_of(layout, trace, name) for name in "xy")
    assert (turned, along) == ("angle from x, lateral", "position along the vein")
    unit = layout["coloraxis"]["colorbar"]["title"]["text"]
    assert trace["hovertemplate"] == f"%{{x:.0f}} deg, %{{y:.1f}} mm: %{{z:.4f}} {unit}<extra></extra>"
    angles, places = degree * numbers(trace["x"]), length * numbers(trace["y"])
    assert (angles[0], angles[-1]) == pytest.approx((-math.pi, math.pi))
    assert (places[0], places[-1]) == pytest.approx((0.0, LENGTH), rel=1e-6, abs=1e-9)
    wanted = 0.08 / stretch(1.0) ** 3 * (1 + 0.3 * places / LENGTH)
    np.testing.assert_allclose(UNITS[unit] * numbers(trace["z"]), np.tile(wanted[:, None], (1, len(angles))), rtol=1e-3)


def test_the_cut(sections: dict[str, list[Any]]) -> None:
    """Where the solids are, and only there, their pressure: the fake's is 100 Pa for each mm of the first place."""
    (trace,), layout = sections["Hydrostatic pressure of the solids"][0]
    (words, size), (across, other) = (axis_of(layout, trace, name) for name in "xy")
    assert (words, across) == ("x, lateral", "y, anterior")
    unit = trace["colorbar"]["title"]["text"]
    assert trace["hovertemplate"] == f"%{{z:.2f}} {unit}<extra></extra>"
    x, y, pressure = size * numbers(trace["x"]), other * numbers(trace["y"]), UNITS[unit] * numbers(trace["z"])
    inside = np.isfinite(pressure)
    volumes = GEOMETRY.exact_volumes()
    wanted = (volumes["tissue"] + volumes["wall"]) / LENGTH
    assert inside.sum() * (x[1] - x[0]) * (y[1] - y[0]) == pytest.approx(wanted, rel=0.03)
    assert np.abs(pressure - 1e5 * x[None, :])[inside].max() < 200
    limits = UNITS[unit] * np.array([trace["zmin"], trace["zmax"]])
    assert limits == pytest.approx(np.percentile(pressure[inside], [1, 99]), rel=1e-6)


def test_pressure_around(run: StoredRun, sections: dict[str, list[Any]]) -> None:
    """Of the fake at the wall's outer face, in sectors."""
    traces, layout = sections["Pressure of the tissue around the vein"][0]
    assert [trace["name"] for trace in traces] == ["odd, t = 0 s", "odd, t = 1.5 s"]
    outer = RADIUS + run.case.geometry.wall_thickness
    for trace in traces:
        (turned, degree), (words, unit) = (axis_of(layout, trace, name) for name in "xy")
        assert (turned, words) == ("angle from x, lateral", "pressure at the wall")
        angle, pressure = degree * numbers(trace["x"]), unit * numbers(trace["y"])
        known = np.isfinite(pressure)
        assert known.sum() > 8
        np.testing.assert_allclose(pressure[known], 1e5 * (X0 + outer * np.cos(angle[known])), atol=120)


IN_SPACE = {
    "Vein in 3-D: odd", "Solids in 3-D: odd", "Mode of collapse: odd", "Wall shear stress on the unrolled vein",
    "Hydrostatic pressure of the solids", "Pressure of the tissue around the vein", "In one dimension",
    "What the result depends on",
}  # fmt: skip
"""Charts that have a test of their own."""


def test_gradient(tmp_path: Path) -> None:
    """A bar for each row of gradient.csv, in the folder of a run, in its order from above."""
    (chart,) = (chart for chart in CHARTS if chart.title == "What the result depends on")
    run: Any = SimpleNamespace(path=tmp_path)
    assert not chart.has(run)
    (tmp_path / "gradient.csv").write_text(
        "quantity,parameter,value,unit,derivative,elasticity\nsawss_mean,a.b,2,Pa,3,0.5\nsawss_mean,c,1,1,1,-0.25\n"
    )
    assert chart.has(run)
    figure = json.loads(chart.make({"odd": run}).to_json())
    (bars,) = figure["data"]
    assert (bars["orientation"], bars["y"], list(numbers(bars["x"]))) == ("h", ["a.b", "c"], [0.5, -0.25])
    assert figure["layout"]["xaxis"]["title"]["text"] == "change of sawss_mean for 1 % of each parameter [%]"
    assert figure["layout"]["yaxis"]["autorange"] == "reversed"


def test_each_chart_has_a_check(sections: dict[str, list[Any]]) -> None:
    drawn = {title for title, parts in sections.items() if any(isinstance(part, tuple) for part in parts)}
    known = {*CURVES, *IN_SPACE}
    assert drawn <= known
    assert {chart.title for chart in CHARTS} - {"Fits of the tube laws"} <= {
        title.removesuffix(": odd") for title in known
    }
    assert all(len([part for part in parts if isinstance(part, tuple)]) <= 1 for parts in sections.values())


CELLS: dict[str, Callable[[Table], str]] = {
    "run": lambda _: "odd",
    "time s": lambda s: f"{s['time_s'][LOADED]:.3g}",
    "skin mmHg": lambda s: ", most ".join(
        f"{s[f'skin_pressure_{which}_Pa'][LOADED] / MMHG:.3g}" for which in ("mean", "max")
    ),
    "volume lost %": lambda s: f"{100 - 100 * s['lumen_volume_m3'][LOADED] / s['lumen_volume_m3'][0]:.1f}",
    "lumen area lost %": lambda s: f"{100 - 100 * s['lumen_area_m2'][LOADED] / s['lumen_area_m2'][0]:.1f}",
    "area inside the skin lost %": lambda s: f"{100 - 100 * s['skin_area_m2'][LOADED] / s['skin_area_m2'][0]:.1f}",
    "SAWSS Pa": lambda s: f"{s['sawss_Pa'][LOADED]:.4f}",
    "SAWSS / t = 0": lambda s: f"{s['sawss_Pa'][LOADED] / s['sawss_Pa'][0]:.2f}",
    "SAWSS by momentum balance Pa": lambda s: f"{s['sawss_consistent_Pa'][LOADED]:.4f}",
    "mass defect / inflow": lambda s: f"{np.abs(s['mass_defect_m3_s']).max() / np.abs(s['flow_in_m3_s']).max():.1e}",
    "low shear % of wall": lambda s: f"{100 * s['wss_low_area_1'][LOADED]:.0f}",
    "largest displacement mm": lambda s: f"{1e3 * s['displacement_max_m'][LOADED]:.3g}",
}
"""Head of the results -> cell."""


def test_results(series: Table, sections: dict[str, list[Any]]) -> None:
    """Each number that is written, of the row of the largest load; every head has its cell here."""
    (head, row), note = sections["Result"]
    assert head == list(CELLS) == ["run", *(shown.head for shown in HEADLINE)]
    assert row == [cell(series) for cell in CELLS.values()]
    assert len(set(row)) == len(row)
    assert re.findall(r"\d+", note) == ["0"]


def test_the_case(run: StoredRun, sections: dict[str, list[Any]]) -> None:
    """Every key with its unit, and its value as in the file of the case."""
    ((head, *rows),) = sections["Setup"]
    assert head == ["key", "value"]

    def flat(tree: Mapping[str, Any], before: str = "") -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key, value in tree.items():
            found |= flat(value, f"{before}{key}.") if isinstance(value, dict) else {f"{before}{key}": value}
        return found

    wanted = flat(tomllib.loads((run.path / "case.toml").read_text(encoding="utf-8")))
    assert {key for key, _ in rows} == {*wanted} - {"name"}
    for key, text in rows:
        value = wanted[key]
        shown = text if isinstance(value, str) else float(text) if isinstance(value, float) else json.loads(text)
        assert shown == (pytest.approx(value, rel=5e-6) if isinstance(value, float) else value), key


def test_fits(run: StoredRun, sections: dict[str, list[Any]]) -> None:
    (head, *rows), note = sections["Fits of the tube laws"]
    assert head == ["run, law", "against", "A0 at mid-length mm²", "K kPa", "rms error of area %", "largest %"]
    wanted = [
        [f"odd, {name}", against, f"{float(fits[5].law.area) / 1e-6:.2f}", f"{float(fits[5].law.stiffness) / 1e3:.3f}",
         f"{100 * overall_error(fits):.3f}", f"{100 * max(fit.largest for fit in fits):.3f}"]
        for against in ("skin", "tissue") for name, fits in tube_laws(run, against).items()
    ]  # fmt: skip
    assert rows == wanted
    assert len({cell for row in rows for cell in row[2:]}) == 4 * len(rows)
    assert note.startswith("Laws: linear")


def test_claims(series: Table, sections: dict[str, list[Any]]) -> None:
    (head, *rows), note, why = sections["Held against the printed numbers"]
    assert head == ["claim", "printed", "computed", "gap"]
    volume, sawss = (series[name] / series[name][0] for name in ("lumen_volume_m3", "sawss_Pa"))
    computed = {
        "volume reduction %": (30.5, 100 * (1 - volume[LOADED])), "sawss rise %": (205.0, 100 * (sawss[LOADED] - 1)),
        "hydrostatic pressure kPa": (5.83, series["p_wall_mean_Pa"][LOADED] / 1e3),
    }  # fmt: skip
    assert rows == [
        [f"odd (M): {claim}", f"{printed:g}", f"{value:.3g}", f"{value - printed:+.3g}"]
        for claim, (printed, value) in computed.items()
    ]
    assert note == "Printed by a book; the pressure is the mean over the wall of the vein."
    parts = {name: 100 * values[LOADED] / series["sawss_Pa"][0] for name, _, _, _, values in causes(series)}
    said = (
        f"a loss of 30.5 % raises SAWSS by {100 * (0.695**-1.5 - 1):.0f} %, not by 205 %;",
        f"With {series['flow_in_m3_s'][0] / 1e-6:.3g} ml/s these add {parts['squeeze flow']:.0f} % and "
        f"{parts['profile']:.0f} % to the {parts['narrowing']:.0f} % of narrowing;",
    )  # fmt: skip
    assert all(sentence in why for sentence in said), why
    assert len(re.findall(r"\d+(?:\.\d+)?", why)) == 7


def test_errors(sections: dict[str, list[Any]], run: StoredRun) -> None:
    """In the report and in the terminal; what a companion that failed does not tell is a dash."""
    (head, *rows), _ = sections["Estimated errors"]
    assert [head[1:], *(row[1:] for row in rows)] == SHOWN_ERRORS
    assert [head[0], *(row[0] for row in rows)] == ["run", "odd", "odd"]
    assert printed(terminal.errors(run)) == SHOWN_ERRORS
    half = [{name: cell for name, cell in row.items() if not name.startswith("time")} for row in run.errors]
    told = error_rows(SimpleNamespace(errors=half))  # type: ignore[arg-type]
    assert told == [[*row[:4], "-", "-"] for row in SHOWN_ERRORS[1:]]


def test_costs(run: StoredRun, sections: dict[str, list[Any]]) -> None:
    ((head, row),) = sections["Costs"]
    manifest = json.loads((run.path / "manifest.json").read_text(encoding="utf-8"))
    wanted = {"run": "odd", "unknowns": "1234", "elements": f"{manifest['mesh']['elements']}", "steps": "6",
              "iterations a step": "4.0", "factorisations": "-", "seconds": f"{manifest['elapsed_s']:.0f}",
              "MB": "512", "solver": "-"}  # fmt: skip
    assert dict(zip(head, row, strict=True)) == wanted


NOTES = {
    "Why it rises": lambda s: "odd at 1 s: " + ", ".join(
        f"{name} {values[LOADED]:.4f} Pa" for name, *_, values in causes(s)[:-1]
    ) + ".",
    "Pressure of the tissue around the vein": lambda s: (
        "Dotted: t = 0. Where a bone shields the vein, less arrives. odd: "
        f"{100 * s['p_tissue_side_Pa'][LOADED] / s['skin_pressure_mean_Pa'][LOADED]:.0f} % of the rise of the skin's "
        "mean pressure arrives at the wall."
    ),
    "Stability": lambda _: f"odd: stable at 1 s, critical {8200 / MMHG:.3g} mmHg.",
}  # fmt: skip
"""Chart -> what the note below it says, or ends with, of the run."""
CHECKED_TEXTS = {"Result", "Held against the printed numbers", "In one dimension", "Fits of the tube laws", "Sources"}


def test_notes(series: Table, sections: dict[str, list[Any]]) -> None:
    """Those with numbers of the run; others have no number but that of the start, t = 0."""
    for title, parts in sections.items():
        for text in (part for part in parts if isinstance(part, str)):
            if title in NOTES:
                assert text.endswith(NOTES[title](series)), title
            elif title not in CHECKED_TEXTS:
                assert not re.findall(r"\d", re.sub(r"t = 0|/3", "", text)), title


def test_each_table_has_a_check(sections: dict[str, list[Any]]) -> None:
    tables = {title for title, parts in sections.items() if any(isinstance(part, list) for part in parts)}
    checked = {
        "Result",
        "Estimated errors",
        "Setup",
        "Fits of the tube laws",
        "In one dimension",
        "Held against the printed numbers",
        "Costs",
    }
    assert tables == checked


def printed(what: Any) -> list[list[str]]:
    console = Console(width=160)
    with console.capture() as captured:
        console.print(what)
    return [[cell.strip() for cell in re.split("[│┃]", line)[1:-1]] for line in captured.get().splitlines()
            if re.search("[│┃]", line)]  # fmt: skip


def test_the_last_row_in_the_terminal(run: StoredRun, series: Table) -> None:
    """Every column with its last value, and the unit that its name ends with; below that the estimated errors."""
    _, *rows = printed(terminal.run_summary(run))
    rows, last = rows[: len(series)], rows[len(series) :]
    assert last == SHOWN_ERRORS
    suffixes = {"Pa": "Pa", "m3_s": "m³/s", "m3": "m³", "m2": "m²", "m": "m", "s": "s", "1": ""}
    wanted = []
    for column, values in series.items():
        suffix = next(one for one in suffixes if column.endswith(f"_{one}"))
        wanted.append([column.removesuffix(f"_{suffix}"), f"{values[-1]:.6g}", suffixes[suffix]])
    assert rows == wanted
    assert len({value for _, value, _ in rows}) > 0.9 * len(rows)


def test_materials_in_the_terminal() -> None:
    """Every number beside its unit: moduli, density and viscosity of each parameter set."""
    sets = [read_set(name) for name in available_sets()]
    head, *rows = printed(terminal.materials())
    assert head == ["set", "law", "G0 kPa", "K0 kPa", "E0 kPa", "nu0", "kg/m³", "mPa s"]
    sizes = {"shear_modulus": 1e3, "bulk_modulus": 1e3, "youngs_modulus": 1e3, "poissons_ratio": 1.0, "density": 1.0,
             "nominal_viscosity": 1e-3}  # fmt: skip
    for row, known in zip(rows, sets, strict=True):
        assert row[:2] == [known.name, known.material.law]
        for cell, (name, size) in zip(row[2:], sizes.items(), strict=True):
            value = getattr(known.material, name, None)
            digits = 5e-4 if name == "poissons_ratio" else 0.0
            assert (size * float(cell) if cell else None) == (value and pytest.approx(value, rel=1e-3, abs=digits))


def test_figures_of_studies(run: StoredRun, series: Table, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Lines over their axes, and the outline at mid-length with its area."""
    made: list[Any] = []
    original = figures.new_figure
    for module in (figures, of_studies):
        monkeypatch.setattr(module, "new_figure", lambda *size: made.append(original(*size)) or made[-1])
    axes = Shown("K", "kPa"), Shown("loss", "percent")
    x, y, spread = np.array([2e3, 3e3]), np.array([0.1, 0.4]), np.array([0.01, 0.02])
    of_studies.lines({"one": [of_studies.Line("a", x, y, spread=spread)]}, axes, tmp_path / "a.png")
    figures.convergence({"one": [figures.Convergence("a", x, y, 1.0)]}, tmp_path / "b.png", axes, {"one": 0.2})
    figures.stacked_bars({"a": {"b": 0.25}, "c": {"b": 0.5}}, axes[1], tmp_path / "c.png")
    group = of_studies.Group("odd", run)
    of_studies.time_series([group], lambda r: r.series["p_wall_mean_Pa"], Shown("pressure", "kPa"), tmp_path / "d.png",
                           comparison=("b", lambda r: r.series["sawss_Pa"]), values=[(1.5e3, "level")])  # fmt: skip
    of_studies.stacked_series({"one": (series["time_s"], {"a": series["sawss_Pa"]})}, "sum", Shown("SAWSS", "kPa"),
                              tmp_path / "e.png")  # fmt: skip
    of_studies.outlines([group], (0.0, 1.0), tmp_path / "f.png")
    level, times = np.full(2, 1500.0), series["time_s"]
    slope = 0.4 * x / 3e3
    rings = [(0.0 + np.asarray(x), np.asarray(y)) for _, _, x, _, y in outline(run)]
    wanted: list[tuple[str, str, list[Any]]] = [
        ("K", "loss", [(x, y)]), ("K", "loss", [(x, y), (x, slope), ([0, 1e3], [0.2, 0.2])]), ("", "loss", []),
        ("time", "pressure", [(times, series["p_wall_mean_Pa"]), (times, series["sawss_Pa"]), None, ([0, 1], level)]),
        ("time", "SAWSS", [(times, series["sawss_Pa"])]), ("x, lateral", "y, anterior", rings),
    ]  # fmt: skip
    for (_, panels), (horizontal, vertical, curves) in zip(made, wanted, strict=True):
        panel = np.ravel(panels)[0]
        sizes = []
        for words, text in ((horizontal, panel.get_xlabel()), (vertical, panel.get_ylabel())):
            assert text.partition(" [")[0] == words
            sizes.append(UNITS[text.partition(" [")[2].rstrip("]")] if text else 1.0)
        drawn = panel.get_lines()[: len(curves)]
        assert len(drawn) == len(curves)
        for line, curve in zip(drawn, curves, strict=True):
            if curve is not None and list(line.get_xdata()) != [0, 1]:
                np.testing.assert_allclose(sizes[0] * np.asarray(line.get_xdata()), curve[0], rtol=1e-9)
            if curve is not None:
                np.testing.assert_allclose(sizes[1] * np.asarray(line.get_ydata()), curve[1], rtol=1e-9)
    assert [(bar.get_y(), bar.get_height()) for bar in made[2][1].patches] == [(0.0, 25.0), (25.0, 50.0)]
    (bars,) = made[0][1].collections
    np.testing.assert_allclose([np.ptp(part[:, 1]) for part in bars.get_segments()], [2.0, 4.0])
    for line, (u, v) in zip(np.ravel(made[5][1])[0].get_lines(), rings, strict=True):
        area = abs(np.dot(u[:-1], v[1:]) - np.dot(u[1:], v[:-1])) / 2
        assert line.get_label().endswith(f": {area / 1e-6:.1f} mm²")


def test_outlines_at_other_stations_differ(run: StoredRun) -> None:
    """The taper tells the outline at mid-length from those beside it, as the check of outlines needs."""
    table = read(run.path / "outlines.csv")
    widths = [np.ptp(table["x_m"][(table["time_s"] == 1.0) & (table["station"] == n)]) for n in range(11)]
    assert np.diff(widths) == pytest.approx(np.full(10, 0.03 * widths[0]), rel=1e-6)


SYMBOLS = "kPa|mmHg|mm|mm²|ml|deg"
TYPED = re.compile(rf"\[[^\]]*\b(?:{SYMBOLS}|Pa|cm|m|s)\b[^\]]*\]|\b(?:{SYMBOLS})\b")
"""A unit between brackets, as on an axis, or one that is not of the SI."""
FACTORS = {10.0**n for n in (-9, -6, -3, -2, 2, 3, 6, 9)}


@pytest.mark.parametrize("path", sorted(Path(ngfsi.report.__file__).parent.glob("*.py")), ids=lambda path: path.name)
def test_no_unit_is_typed_beside_a_factor(path: Path) -> None:
    """In the room that shows numbers a unit is named to `Shown` and `in_unit` alone, which know its factor."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    docs = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    named = {id(one) for node in ast.walk(tree) if isinstance(node, ast.Call) for one in node.args}
    typed = [
        node.value for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs | named
        and TYPED.search(node.value)
    ]  # fmt: skip
    assert typed == []
    factors = [
        ast.unparse(node) for node in ast.walk(tree) if isinstance(node, ast.BinOp)
        and isinstance(node.op, (ast.Mult, ast.Div))
        for side in (node.left, node.right) if isinstance(side, ast.Constant) and side.value in FACTORS
    ]  # fmt: skip
    assert [text for text in factors if text != "0.001 * np.ptp(bounds[0])"] == []
