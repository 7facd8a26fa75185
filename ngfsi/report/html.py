"""The report of one run or several compared: a single HTML file that needs no network, with interactive charts.

What a run does not have, by its model, is left out; a chart that fails although it could be drawn says why.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import plotly.graph_objects as go
from jinja2 import Environment
from markupsafe import Markup
from plotly.io import write_images
from plotly.offline import get_plotlyjs

from ngfsi.analysis.decomposition import STAGES, decompose, narrowing
from ngfsi.analysis.transmission import transmission
from ngfsi.analysis.tube import externals, in_one_dimension, overall_error, transmural, tube_laws
from ngfsi.errors import NgfsiError, OutputError
from ngfsi.report import charts
from ngfsi.report.charts import Runs
from ngfsi.report.shapes import MOVED, is_plane
from ngfsi.report.tables import ERRORS_HEAD, error_rows, flat
from ngfsi.store.disk import explained, replace_file
from ngfsi.store.stored import StoredRun, open_run
from ngfsi.units import DOT, INCH, POINT, Shown, in_unit, to_si, unit_of

PAGE = to_si(170.0, "mm")
"""Width of the text of a journal's page."""
FONT = {"family": "Arial, Helvetica, DejaVu Sans, sans-serif", "size": 8 * POINT / DOT}
TALLEST, TALLEST_IN_SPACE = 1.0, 0.5
"""Height of a figure over its width, at most; what is seen in 3-D is cut at the sides where the figure is higher."""
DOTS_OF_PRINT = 300
"""In an inch."""
REFERENCES = (
    "Y. Wang, PhD thesis on the effect of external compression on the deep veins of the calf (supervisor X. Y. Xu); "
    "Wang et al., Med Eng Phys (2011).",
    "He and Ku, J Biomech Eng 118 (1996) 74: oscillatory shear index. Himburg et al., Ann Biomed Eng 32 (2004) 410: "
    "relative residence time.",
    "Melbo and Kvamsdal, CMAME 192 (2003) 613: tractions from the balance of momentum.",
    "Schöberl, C++11 implementation of finite elements in NGSolve (2014); NETGEN, Comput Visual Sci 1 (1997) 41.",
)


@dataclass(frozen=True)
class Table:
    """A table; with a summary it is folded under that."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    kind: str = ""
    summary: str = ""


Part: TypeAlias = Table | go.Figure | str | Sequence[str]
"""A table, a chart, a note or a list."""
Section = tuple[str, Sequence[Part]]


@dataclass(frozen=True)
class Chart:
    """A section on those runs that have what it shows.

    Attributes:
        of: "vessel": one for each vessel; "branch": one for each centreline of each vessel; "run": one for each run;
            "all": one for all.
        make: returns the figure, or all parts of the section.
        has: whether a run has what it shows.
        note: below it.
        said: of a title and its run, what is added to the note.
    """

    title: str
    of: Literal["vessel", "branch", "run", "all"]
    make: Callable[[Runs], go.Figure | list[Part]]
    has: Callable[[StoredRun], bool]
    note: str = ""
    said: Callable[[str, StoredRun], str] = lambda title, run: ""  # noqa: ARG005 - nothing


def report(folders: Sequence[Path], destination: Path, claims: Mapping[str, Any] | None = None) -> Path:
    """Write the report of stored runs as HTML and return its path.

    Args:
        claims: printed numbers to hold the runs against, by claim and law (M, N), as in the group `ngfsi.claims`;
            `citation` and `remark` are shown with them.

    Raises:
        OutputError: a folder holds no run, or no step of one, or the file cannot be written.
    """
    runs = _named(folders)
    for title, run in runs.items():
        if not len(run.series.get("time_s", ())):
            raise OutputError(f"the run '{title}' in '{run.path}' holds no step yet: nothing can be reported of it")
    sections = [
        _headline(runs),
        *_errors(runs),
        _setup(runs),
        *_charts(runs),
        *_claims(runs, claims or {}),
        _costs(runs),
        _sources(runs),
    ]
    template = Environment(autoescape=True).from_string(
        files("ngfsi.report").joinpath("report.html.j2").read_text(encoding="utf-8")
    )
    drawn = [(title, [_in_html(title, part) for part in parts]) for title, parts in sections]
    text = template.render(title="ngfsi: " + ", ".join(runs), sections=drawn, plotly=get_plotlyjs())
    replace_file(destination, text.encode())
    return destination


def figures(folders: Sequence[Path], destination: Path, width: float = PAGE) -> list[Path]:
    """Write each chart of the report of stored runs as SVG, PDF and PNG, those in 3-D as PNG, and return the files.

    Args:
        width: of the figures (m), whose text has 8 points.

    Raises:
        OutputError: a folder holds no run, there is no browser to draw with, or the files cannot be written.
    """
    drawn: list[dict[str, Any]] = []
    with explained(destination, "made"):
        destination.mkdir(parents=True, exist_ok=True)
    for title, parts in _charts(_named(folders)):
        for figure in parts:
            if isinstance(figure, go.Figure):
                _print(figure, title)
                in_space = any(trace.type == "mesh3d" for trace in figure.data)
                for kind in ("png",) if in_space else ("svg", "pdf", "png"):
                    scale = DOTS_OF_PRINT * DOT / INCH if kind == "png" else 1.0
                    highest = (TALLEST_IN_SPACE if in_space else TALLEST) * width / DOT
                    size = {"width": width / DOT, "height": min(figure.layout.height, highest)}
                    file = destination / f"{_slug(title)}.{kind}"
                    drawn.append({"fig": figure, "file": file, "scale": scale, **size})
    try:
        write_images(**{key: [one[key] for one in drawn] for key in ("fig", "file", "scale", "width", "height")})
    except Exception as error:  # of kaleido and of the browser, which have no common class
        raise OutputError(
            "figures are drawn by kaleido with Chrome or Chromium, which did not work here (pip install kaleido; on "
            f"Debian or Ubuntu: apt-get install chromium): {error}"
        ) from None
    return [one["file"] for one in drawn]


def _print(figure: go.Figure, title: str) -> None:
    """Give a figure what it has on paper: its title, text of one size, the legend below, and nothing to move."""
    figure.update_layout(
        title=title, title_yref="container", title_y=0.98, title_yanchor="top", font=FONT, title_font=FONT,
        legend={"yref": "container", "y": 0, "yanchor": "bottom"}, margin_t=50,
    )  # fmt: skip
    if figure.layout.sliders:
        figure.layout.sliders, figure.layout.margin.b = (), 10
    figure.update_xaxes(title_font=FONT).update_yaxes(title_font=FONT).update_annotations(font=FONT)


def _in_html(title: str, part: Part) -> Part:
    if not isinstance(part, go.Figure):
        return part
    name = _slug(title)
    config = {"displaylogo": False, "responsive": True, "toImageButtonOptions": {"format": "svg", "filename": name}}
    return Markup(part.to_html(full_html=False, include_plotlyjs=False, config=config, div_id=name))


def _slug(title: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in title.lower())


def _named(folders: Sequence[Path]) -> dict[str, StoredRun]:
    """Return the runs by the name of their case, or of their folder where cases are named alike."""
    opened = [open_run(folder) for folder in folders]
    names = [run.case.name for run in opened]
    if len(set(names)) < len(names):
        names = [str(run.path) for run in opened]
    return dict(zip(names, opened, strict=True))


def _views(of: str, runs: Runs, has: Callable[[StoredRun], bool]) -> list[tuple[str, Runs]]:
    """Return what titles end with, and the runs that have something; as of `Chart.of`."""
    views: dict[str, dict[str, StoredRun]] = {}
    for title, run in runs.items():
        parts = {f": {title}" if of == "run" else "": run} if of in ("run", "all") else _vessels(run, of == "branch")
        for ending, view in parts.items():
            if has(view):
                views.setdefault(ending, {})[title] = view
    return list(views.items())


def _vessels(run: StoredRun, branches: bool) -> dict[str, StoredRun]:
    """Return the run as if of each vessel alone, and of each further centreline of it, by what titles end with."""
    found = {}
    for name, vessel in run.vessels.items() or {"": None}.items():
        view = run.of_vessel(name) if len(run.vessels) > 1 else run
        for branch in ("", *(vessel.further if vessel and branches else ())):
            ending = "".join(f", {part}" for part in (name, branch) if part)
            found[ending] = view.of_branch(branch) if branch else view
    return found


def _holds(*columns: str) -> Callable[[StoredRun], bool]:
    """Return whether the series of a run has columns."""
    return lambda run: set(columns) <= set(run.series)


def _is_branched(run: StoredRun) -> bool:
    return bool(run.vessels and run.own_vessel.further)


def _has_wall_fields(run: StoredRun) -> bool:
    return bool(run.vessels and run.own_vessel.centreline and run.field_times("wall"))


def _has_outlines(run: StoredRun) -> bool:
    return bool(run.vessels and run.own_vessel.centreline and (run.path / "outlines.csv").exists())


def _has_solids(run: StoredRun) -> bool:
    return bool(run.case.geometry.solids and run.field_times())


def _has_body(run: StoredRun) -> bool:
    return _has_solids(run) and not is_plane(run.fields(0.0))


def _has_stages(run: StoredRun) -> bool:
    return "smallest_eigenvalue_1_s2" in run.stability


def _has_tissue(run: StoredRun) -> bool:
    return bool(run.vessels) and _has_solids(run) and "p_tissue_side_Pa" in run.series


def _share_of_start(column: str, name: str) -> Callable[[Runs], Any]:
    lines = {name: lambda run: run.series[column] / run.series[column][0]}
    return lambda runs: charts.over_time(runs, lines, Shown(name, "percent", "of t = 0"))


def _over_time(shown: Shown, columns: Mapping[str, str], dashed: Sequence[str] = ()) -> Callable[[Runs], Any]:
    """Return the maker of a chart of columns over time; name of the line -> column."""
    return lambda runs: charts.over_time(runs, columns, shown, dashed=dashed)


def _along(name: str, shown: Shown) -> Callable[[Runs], Any]:
    return lambda runs: charts.along_vein(runs, name, shown)


def _around_vein(runs: Runs) -> Any:
    lines: dict[str, Any] = {"tissue side": "p_tissue_side_Pa"}
    if all(run.skin_pressure is not None for run in runs.values()):
        lines["skin"] = lambda run: run.skin_pressure
    return charts.over_time(runs, lines, Shown("pressure", "kPa"), dashed=("skin",))


def _stability(title: str, run: StoredRun) -> str:
    stage = int(np.argmin(np.abs(run.stability["time_s"] - run.loaded_time)))
    time, critical, eigenvalue = (
        run.stability[name][stage] for name in ("time_s", "critical_skin_pressure_Pa", "smallest_eigenvalue_1_s2")
    )
    where = f", critical {in_unit(critical, 'mmHg', '.3g')}" if np.isfinite(critical) else ""
    return f"{title}: {'stable' if eigenvalue > 0 else 'not stable'} at {in_unit(time, 's', '.3g')}{where}."


def _causes(title: str, run: StoredRun) -> str:
    row, found = run.loaded_row, decompose(run.series).items()
    parts = ", ".join(f"{cause} {in_unit(values[row], 'Pa', '.4f')}" for cause, values in found)
    return f"{title} at {in_unit(run.series['time_s'][row], 's', '.3g')}: {parts}."


def _transmission(title: str, run: StoredRun) -> str:
    fraction = transmission(run)[run.loaded_row]
    part = in_unit(fraction, "percent", ".0f")
    return "" if np.isnan(fraction) else f"{title}: {part} of the rise of the skin's mean pressure arrives at the wall."


def _has_tube_law(run: StoredRun) -> bool:
    """Return whether areas of a vessel with a wall, under loads that change, are known."""
    if _is_branched(run) or not (
        run.vessels and run.own_vessel.wall and "area_z00_m2" in run.series and externals(run)
    ):
        return False
    return all(np.ptp(transmural(run, against)) for against in externals(run))


def _fits(runs: Runs) -> list[Part]:
    area, stiffness = Shown("A0 at mid-length", "mm2"), Shown("K", "kPa")
    error, largest = Shown("rms error of area", "percent"), Shown("largest", "percent")
    rows = []
    for title, run in runs.items():
        for against in externals(run):
            for name, fits in tube_laws(run, against).items():
                middle = fits[len(fits) // 2].law
                rows.append([f"{title}, {name}", against, f"{area(float(middle.area)):.2f}",
                             f"{stiffness(float(middle.stiffness)):.3f}", f"{error(overall_error(fits)):.3f}",
                             f"{largest(max(one.largest for one in fits)):.3f}"])  # fmt: skip
    return [Table(["run, law", "against", *(shown.head for shown in (area, stiffness, error, largest))], rows)]


def _in_one_dimension(runs: Runs) -> list[Part]:
    compared, gap = {title: in_one_dimension(run) for title, run in runs.items()}, Shown("mean, rms", "percent")
    head = ["run, 1-D against 3-D", *(f"{name}: {gap.head}" for name in next(iter(compared.values())).gaps)]
    rows = [
        [name, *(f"{gap(found.mean):+.2f}, {gap(found.rms):.2f}" for found in one.gaps.values())]
        for name, one in compared.items()
    ]
    return [charts.one_dimension(compared), Table(head, rows)]


FLOW = Shown("flow", "ml_s")
LOADED = "the stored time nearest to the last at which the load is at its largest"
CHARTS = (
    Chart("Area of the lumen", "vessel",
          _share_of_start("lumen_area_mean_m2", "mean area"),
          _holds("lumen_area_mean_m2")),
    Chart("Volume of the lumen", "vessel",
          _share_of_start("lumen_volume_m3", "volume"),
          lambda run: _is_branched(run) and "lumen_volume_m3" in run.series),
    Chart("Area of the lumen in the section", "vessel",
          _share_of_start("lumen_area_m2", "area"),
          _holds("lumen_area_m2")),
    Chart("Area inside the skin", "all",
          _share_of_start("skin_area_m2", "area"),
          _holds("skin_area_m2")),
    Chart("Largest displacement", "all", _over_time(MOVED, {"displacement": "displacement_max_m"}),
          lambda run: "displacement_max_m" in run.series and not any(name.endswith("sawss_Pa") for name in run.series)),
    Chart("Wall shear stress", "vessel",
          _over_time(charts.SAWSS, {"computed": "sawss_Pa", "developed flow": "sawss_poiseuille_local_Pa"},
                     ("developed flow",)),
          _holds("sawss_Pa", "sawss_poiseuille_local_Pa"),
          "Dashed: developed flow in circles of the same local area, with the same local flow."),
    Chart("Wall shear stress, mean", "vessel", _over_time(charts.SAWSS, {"computed": "sawss_Pa"}),
          lambda run: _is_branched(run) and "sawss_Pa" in run.series,
          "Over the walls of all branches."),
    Chart("Why it rises", "vessel", charts.causes, _holds(*STAGES.values()), said=_causes),
    Chart("Along the vein: area", "branch",
          _along("area", Shown("lumen area", "mm2")), _holds("area_z00_m2"),
          "Dotted: t = 0."),
    Chart("Along the vein: wall shear stress", "branch",
          _along("wss", Shown("WSS, mean around", "Pa")), _holds("wss_z00_Pa"),
          "Dotted: t = 0."),
    Chart("Along the vein: flow", "branch",
          _along("flow", FLOW), _holds("flow_z00_m3_s"),
          "Dotted: t = 0. It changes at a fork by what other branches take or bring."),
    Chart("Outline of the lumen at mid-length", "branch", charts.outlines, _has_outlines, "Grey: t = 0."),
    Chart("Wall shear stress on the unrolled vein", "branch", charts.unrolled, _has_wall_fields, f"At {LOADED}."),
    Chart("Hydrostatic pressure of the solids", "all", charts.cut, _has_solids,
          f"-tr(sigma)/3, compression positive, at mid-length at {LOADED}; bones and lumen are left out."),
    Chart("Pressure of the tissue around the vein", "vessel", charts.around, _has_tissue,
          "Dotted: t = 0. Where a bone shields the vein, less arrives.", _transmission),
    Chart("Vein in 3-D", "run", charts.vein, _has_wall_fields, "Drag to turn; wall shear stress."),
    Chart("Solids in 3-D", "run", charts.half, _has_body, "Lower half of the deformed shape, displacement."),
    Chart("Flow balance", "vessel",
          _over_time(FLOW, {"inflow": "flow_in_m3_s", "outflow": "flow_out_m3_s",
                            "rate of volume": "lumen_volume_rate_m3_s"}, ("inflow",)),
          _holds("flow_in_m3_s", "flow_out_m3_s", "lumen_volume_rate_m3_s"),
          "Inflow = outflow + rate of the lumen's volume."),
    Chart("Pressure around the vein", "vessel", _around_vein, _holds("p_tissue_side_Pa"),
          "Hydrostatic pressure of the tissue at the outer face of the vein's wall, and mean pressure on the skin."),
    Chart("Stability", "all", charts.stability, _has_stages,
          "Critical: where the tangent of tissue and wall, the blood's pressure held, becomes singular on the straight "
          "line through two stages; it is reliable near the dashed line, where the vein collapses.", _stability),
    Chart("Stiffness of the softest motion", "all", charts.softest,
          lambda run: "softest_stiffness_1" in run.stability,
          "Over that of shear alone in the solids' initial moduli; it vanishes where the section buckles."),
    Chart("Mode of collapse", "run", charts.collapse, _has_stages,
          "Lower half of the solids, moved along the mode; colour: its relative size."),
    Chart("Along the vein: transmural pressure", "branch",
          _along("p_transmural", Shown("transmural pressure", "kPa")), _holds("p_transmural_z00_Pa"),
          "Blood less tissue: its normal traction on the wall, mean around. Dotted: t = 0."),
    Chart("Tube law", "vessel", charts.tube_law, _has_tube_law),
    Chart("Fits of the tube laws", "vessel", _fits, _has_tube_law,
          "Laws: linear, T = K (a - 1) with a = A/A0; elastic ring, K (sqrt a - 1), Sherwin et al., J Eng Math 47 "
          "(2003); collapsible, K (a^10 - a^-1.5), Shapiro, J Biomech Eng 99 (1977), Brook et al., J Fluid Mech 396 "
          "(1999). Errors are relative to the computed areas at all stations and times."),
    Chart("In one dimension", "vessel", _in_one_dimension,
          lambda run: _has_tube_law(run) and "skin" in externals(run) and "sawss_Pa" in run.series,
          "Solid: this run; dashed: mass, momentum, the best tube law against the skin, and unsteady laminar friction "
          "along the vein, with the same loads. Table: gap of the mean over time, and root mean square, over the mean "
          "of the three-dimensional run. Coarse steps damp the swinging of the blood there."),
    Chart("What the result depends on", "run", charts.elasticities,
          lambda run: (run.path / charts.GRADIENT).exists(),
          "By the adjoint of the whole run; `ngfsi gradient CASE -o RUN` leaves it in the folder of the run."),
)  # fmt: skip


def _charts(runs: Runs) -> list[Section]:
    return [
        (f"{chart.title}{ending}", _parts(chart, views))
        for chart in CHARTS
        for ending, views in _views(chart.of, runs, chart.has)
    ]


def _parts(chart: Chart, runs: Runs) -> list[Part]:
    try:
        made = chart.make(runs)
        note = " ".join(filter(None, [chart.note, *(chart.said(title, run) for title, run in runs.items())]))
    except (NgfsiError, KeyError) as error:
        missing = error if isinstance(error, NgfsiError) else f"the run holds no {error}"
        return [f"Not shown: {missing}"]
    return [*(made if isinstance(made, list) else [made]), *filter(None, [note])]


def _lost(column: str) -> Callable[[StoredRun, int], float]:
    return lambda run, row: 1 - run.series[column][row] / run.series[column][0]


def _over_start(run: StoredRun, row: int) -> float:
    sawss = run.series["sawss_Pa"]
    return float(sawss[row] / sawss[0]) if sawss[0] else np.nan


def _defect(run: StoredRun, _: int) -> float:
    inflow = np.max(np.abs(run.series["flow_in_m3_s"]))
    return float(np.max(np.abs(run.series["mass_defect_m3_s"])) / inflow) if inflow else np.nan


HEADLINE: Mapping[Shown, tuple[str, str | Callable[[StoredRun, int], Any]]] = {
    Shown("time", "s"): (".3g", "time_s"),
    Shown("skin", "mmHg"): (".3g", lambda run, row: np.array(run.on_skin(run.series["time_s"][row]))),
    Shown("volume lost", "percent"): ("b.1f", _lost("lumen_volume_m3")),
    Shown("lumen area lost", "percent"): ("b.1f", _lost("lumen_area_m2")),
    Shown("area inside the skin lost", "percent"): ("b.1f", _lost("skin_area_m2")),
    Shown("SAWSS", "Pa"): (".4f", "sawss_Pa"),
    Shown("SAWSS / t = 0", "1"): ("b.2f", _over_start),
    Shown("SAWSS by momentum balance", "Pa"): (".4f", "sawss_consistent_Pa"),
    Shown("mass defect / inflow", "1"): (".1e", _defect),
    Shown("low shear", "percent", "of wall"): (".0f", "wss_low_area_1"),
    Shown("largest displacement", "mm"): (".3g", "displacement_max_m"),
}
"""Head -> format, after a "b" if bold, and column or SI value of a run and row; of two values the second is the
largest."""


def _cell(shown: Shown, spec: str, of: str | Callable[[StoredRun, int], Any], run: StoredRun) -> Any:
    """Return a cell of the headline; "-" where there is no number, None where the run has no such quantity."""
    try:
        values = run.series[shown.check(of)][run.loaded_row] if isinstance(of, str) else of(run, run.loaded_row)
    except KeyError:
        return None
    text = ", most ".join(format(value, spec.removeprefix("b")) for value in shown(np.atleast_1d(values)))
    return ("-" if "nan" in text else Markup("<b>{}</b>").format(text) if spec.startswith("b") else text) or None


def _headline(runs: Runs) -> Section:
    found: dict[Any, dict[str, Any]] = {}
    for ending, views in _views("vessel", runs, lambda _: True):
        for title, run in views.items():
            cells = {shown.head: _cell(shown, *how, run) for shown, how in HEADLINE.items()}
            found[Markup("{}{}{}").format(title, ending, _ended(run))] = cells
    heads = [shown.head for shown in HEADLINE if any(cells[shown.head] for cells in found.values())]
    rows = [[title, *(cells[head] or "-" for head in heads)] for title, cells in found.items()]
    note = (
        "When the load on the skin is first at its largest; without such a load solids alone when they are displaced "
        "most, others at the last time."
    )
    if charts.SAWSS.head in heads:
        note += (
            " Volume and SAWSS (wall shear stress, mean over the deformed wall) are held against the state at t = 0. "
            "SAWSS from the gradient of the velocity and from the balance of momentum would be equal on an infinitely "
            "fine mesh: their difference is of the size of the spatial error."
        )
    return "Result", [Table(["run", *heads], rows), note]


def _errors(runs: Runs) -> list[Section]:
    rows = [[title, *row] for title, run in runs.items() for row in error_rows(run)]
    note = (
        "Of the loss over the largest loss, of wall shear stress over its mean in time. From space: twice the change "
        "at the end in elements of one order more on the same mesh; where that cannot be, the difference to a run of "
        "one order less, with the largest in time. From time: by the difference to a run with steps of double size, at "
        "the end and the largest at the times in common. How good that is: docs/theory.md."
    )
    return [("Estimated errors", [Table(["run", *ERRORS_HEAD], rows), note])] if rows else []


def _ended(run: StoredRun) -> str:
    if run.status == "completed":
        return ""
    return Markup(' <span class="bad">{}: {}</span>').format(run.status, run.manifest.get("reason", ""))


def _setup(runs: Runs) -> Section:
    """Return the cases, keys that differ first."""
    cases = [flat(run.case.to_toml_dict()) for run in runs.values()]
    keys = list(dict.fromkeys(key for case in cases for key in case if key != "name"))
    rows = {key: [_value(case.get(key, "-")) for case in cases] for key in keys}
    differing = {key: values for key, values in rows.items() if len(set(values)) > 1}
    same = [[key, values[0]] for key, values in rows.items() if key not in differing]
    shown: list[Part] = []
    if differing:
        shown = [Table(["key", *runs], [[key, *values] for key, values in differing.items()], "differs")]
    elif len(runs) > 1:
        shown = ["The cases are equal."]
    what = "What the cases have in common" if len(runs) > 1 else "The case"
    return "Setup", [*shown, Table(["key", "value"], same, summary=what)]


def _value(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _claims(runs: Runs, claims: Mapping[str, Any]) -> list[Section]:
    """Return the printed numbers beside those of runs with the law they are of, and why they can or cannot be met."""
    rows, why = [], []
    for title, run in runs.items():
        law, series = _law(run), run.series
        if law is None or not claims or not _holds("lumen_volume_m3", "sawss_Pa", "p_wall_mean_Pa")(run):
            continue
        row = run.loaded_row
        computed = {
            "volume_reduction_percent": _lost("lumen_volume_m3")(run, row),
            "sawss_rise_percent": series["sawss_Pa"][row] / series["sawss_Pa"][0] - 1,
            "hydrostatic_pressure_kPa": series["p_wall_mean_Pa"][row],
        }
        printed = {key: to_si(claims[key][law], unit_of(key)) for key in computed if law in claims.get(key, {})}
        for key, number in printed.items():
            shown = Shown(key.removesuffix(f"_{unit_of(key)}").replace("_", " "), unit_of(key))
            rows.append([f"{title} ({law}): {shown.head}", f"{shown(number):g}", f"{shown(computed[key]):.3g}",
                         f"{shown(computed[key] - number):+.3g}"])  # fmt: skip
        if {"volume_reduction_percent", "sawss_rise_percent"} <= set(printed) and _holds(*STAGES.values())(run):
            why.append(_why(title, run, printed["volume_reduction_percent"], printed["sawss_rise_percent"]))
    if not rows:
        return []
    note = f"Printed by {claims.get('citation', 'the source')}; the pressure is the mean over the wall of the vein."
    if remark := claims.get("remark"):
        note += f" {remark}"
    table = Table(["claim", "printed", "computed", "gap"], rows)
    return [("Held against the printed numbers", [table, note, " ".join(why)])]


def _why(title: str, run: StoredRun, loss: float, rise: float) -> str:
    """Return why the printed rise of SAWSS can or cannot follow from the printed loss of volume, both relative."""
    row, start, causes = run.loaded_row, float(run.series["sawss_Pa"][0]), decompose(run.series)
    part = {cause: in_unit(values[row] / start, "percent", ".0f") for cause, values in causes.items()}
    alone = in_unit(narrowing(loss) - 1, "percent", ".0f")
    flow = in_unit(run.series["flow_in_m3_s"][0], "ml_s", ".3g")
    return (
        f"{title}: at a constant flow a loss of {in_unit(loss, 'percent')} raises SAWSS by {alone}, not by "
        f"{in_unit(rise, 'percent')}; the rest must be blood that the vein expels itself and profiles that had no time "
        f"to develop. With {flow} these add {part['squeeze flow']} and {part['profile']} to the {part['narrowing']} of "
        "narrowing; their part grows as the flow falls (study flow_rate)."
    )


def _law(run: StoredRun) -> str | None:
    """Return the source's letter for the law of a run's tissue."""
    return {"mooney_rivlin": "M", "neo_hookean": "N"}.get(getattr(run.case.materials.tissue, "law", ""))


def _costs(runs: Runs) -> Section:
    head = ["run", "unknowns", "elements", "steps", "iterations a step", "factorisations", "seconds", "MB", "solver"]
    rows = []
    for title, run in runs.items():
        found, costs = run.manifest, run.costs
        steps = len(costs.get("step", ()))
        rows.append([
            title, f"{found.get('unknowns', '-')}", f"{found.get('mesh', {}).get('elements', '-')}", f"{steps}",
            f"{costs['iterations'].mean():.1f}" if steps else "-", f"{found.get('factorisations', '-')}",
            f"{found.get('elapsed_s', float('nan')):.0f}", f"{found.get('peak_memory_MB', float('nan')):.0f}",
            str(found.get("linear_solver", "-")),
        ])  # fmt: skip
    return "Costs", [Table(head, rows)]


def _sources(runs: Runs) -> Section:
    used = dict.fromkeys(
        f"{title}: " + ", ".join(f"{name} {version}" for name, version in run.manifest["versions"].items())
        for title, run in runs.items()
    )
    return "Sources", [[*REFERENCES, *used]]
