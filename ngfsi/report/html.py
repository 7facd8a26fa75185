"""The report of one run or several compared: a single HTML file that needs no network, with interactive charts."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from plotly.io import write_images
from plotly.offline import get_plotlyjs

from ngfsi.analysis.decomposition import STAGES, decompose, narrowing
from ngfsi.analysis.transmission import transmission
from ngfsi.analysis.tube import Comparison, externals, in_one_dimension, overall_error, tube_laws
from ngfsi.errors import NgfsiError, OutputError
from ngfsi.report import charts
from ngfsi.report.charts import Runs
from ngfsi.store.disk import explained
from ngfsi.store.stored import SAME_TIME, StoredRun, open_run
from ngfsi.units import from_si

REFERENCES = (
    "Y. Wang, PhD thesis on the effect of external compression on the deep veins of the calf (supervisor X. Y. Xu); "
    "Wang et al., Med Eng Phys (2011).",
    "He and Ku, J Biomech Eng 118 (1996) 74: oscillatory shear index. Himburg et al., Ann Biomed Eng 32 (2004) 410: "
    "relative residence time.",
    "Melbo and Kvamsdal, CMAME 192 (2003) 613: tractions from the balance of momentum.",
    "Schöberl, C++11 implementation of finite elements in NGSolve (2014); NETGEN, Comput Visual Sci 1 (1997) 41.",
)
Chart = tuple[str, Callable[[], Any], str]
"""Title, maker and note of a chart."""
STYLE = """
body{font:15px/1.5 system-ui,sans-serif;margin:0 auto;max-width:1200px;padding:1.5rem;color:#1a1a1a}
h1{font-size:1.6rem}h2{font-size:1.2rem;margin-top:2.2rem;border-bottom:1px solid #ccc}
table{border-collapse:collapse;margin:.6rem 0}td,th{padding:.2rem .8rem;text-align:right;border-bottom:1px solid #ddd}
td:first-child,th:first-child{text-align:left}tr.differs{background:#fff3d6}p.note{color:#555;max-width:60rem}
.bad{color:#b00000;font-weight:600}
"""


def report(folders: Sequence[Path], destination: Path, claims: Mapping[str, Any] | None = None) -> Path:
    """Write the report of stored runs and return its path.

    Args:
        folders: of the runs.
        destination: HTML file to write.
        claims: printed numbers to hold the runs against, by claim and law (M, N), as in the group `ngfsi.claims`.

    Raises:
        OutputError: a folder holds no run, or no step of one, or the file cannot be written.
    """
    runs = _named(folders)
    for title, run in runs.items():
        if not len(run.series.get("time_s", ())):
            raise OutputError(f"the run '{title}' in '{run.path}' holds no step yet: nothing can be reported of it")
    sections = [
        _headline(runs),
        _setup(runs),
        *(_chart(*one) for one in _charts(runs)),
        *_tube(runs),
        _claims(runs, claims or {}),
        _costs(runs),
        _sources(runs),
    ]
    title = "ngfsi: " + ", ".join(runs)
    text = (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{STYLE}</style><script>{get_plotlyjs()}</script></head><body><h1>{escape(title)}</h1>"
        + "\n".join(sections)
        + "</body></html>"
    )
    with explained(destination):
        destination.parent.mkdir(parents=True, exist_ok=True)
        destination.write_text(text, encoding="utf-8")
    return destination


def figures(folders: Sequence[Path], destination: Path) -> list[Path]:
    """Write each chart of the report of stored runs as SVG and as PNG, those in space as PNG, and return the files.

    Args:
        folders: of the runs.
        destination: folder of the figures.

    Raises:
        OutputError: a folder holds no run, there is no browser to draw with, or the files cannot be written.
    """
    runs = _named(folders)
    drawn: list[Any] = []
    files: list[Path] = []
    with explained(destination, "made"):
        destination.mkdir(parents=True, exist_ok=True)
    one_dimension = ("In one dimension", lambda: charts.one_dimension(_in_one_dimension(runs)), "")
    for title, make, _ in (*_charts(runs), *_tube_charts(runs), one_dimension):
        try:
            figure = make()
        except (NgfsiError, KeyError):  # the report says why
            continue
        figure.update_layout(title=title, width=1000, margin_t=80)
        in_space = any(trace.type == "mesh3d" for trace in figure.data)
        for kind in ("png",) if in_space else ("svg", "png"):
            drawn.append(figure)
            files.append(destination / f"{_slug(title)}.{kind}")
    try:
        write_images(drawn, files, scale=2)
    except Exception as error:  # of kaleido and of the browser, which have no common class
        raise OutputError(
            "figures are drawn by kaleido with Chrome or Chromium, which did not work here (pip install kaleido; on "
            f"Debian or Ubuntu: apt-get install chromium): {error}"
        ) from None
    return files


def _slug(title: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in title.lower())


def _named(folders: Sequence[Path]) -> dict[str, StoredRun]:
    """Return the runs by the name of their case, or of their folder where cases are named alike."""
    opened = [open_run(folder) for folder in folders]
    names = [run.case.name for run in opened]
    if len(set(names)) < len(names):
        names = [str(run.path) for run in opened]
    return dict(zip(names, opened, strict=True))


def _loaded(run: StoredRun) -> int:
    """Return the row of the series when the last load has been reached, or the last row."""
    times = run.series["time_s"]
    end = max(run.case.loads.skin_pressure.breakpoints, default=0.0) or times[-1]
    return int(np.searchsorted(times, end + SAME_TIME)) - 1


def _headline(runs: Runs) -> str:
    head = ["run", "time s", "skin mmHg", "volume lost %", "SAWSS Pa", "SAWSS / t = 0", "SAWSS by momentum balance Pa",
            "mass defect / inflow", "low shear, % of wall"]  # fmt: skip
    rows = []
    for title, run in runs.items():
        series, row = run.series, _loaded(run)
        sawss, volume = series["sawss_Pa"], series["lumen_volume_m3"]
        defect = np.max(np.abs(series["mass_defect_m3_s"])) / np.max(np.abs(series["flow_in_m3_s"]))
        cells = [
            f"{series['time_s'][row]:.3g}",
            f"{from_si(series['skin_pressure_Pa'][row], 'mmHg'):.3g}",
            f"<b>{100 * (1 - volume[row] / volume[0]):.1f}</b>",
            f"{sawss[row]:.4f}",
            f"<b>{sawss[row] / sawss[0]:.2f}</b>",
            _optional(series, "sawss_consistent_Pa", row, lambda other: f"{other:.4f}"),
            f"{defect:.1e}",
            _optional(series, "wss_low_area_1", row, lambda share: f"{100 * share:.0f}"),
        ]
        rows.append([escape(title) + _ended(run), *cells])
    note = (
        "When the load on the skin has been reached. Volume and SAWSS (wall shear stress, mean over the deformed wall) "
        "are held against the state at t = 0. SAWSS from the gradient of the velocity and from the balance of momentum "
        "would be equal on an infinitely fine mesh: their difference is of the size of the error in space."
    )
    return f"<h2>Result</h2>{_table(head, rows)}{_note(note)}"


def _optional(series: Mapping[str, Any], column: str, row: int, text: Callable[[float], str]) -> str:
    return text(float(series[column][row])) if column in series else "-"


def _ended(run: StoredRun) -> str:
    if run.status == "completed":
        return ""
    return f' <span class="bad">{escape(run.status)}: {escape(str(run.manifest.get("reason", "")))}</span>'


def _setup(runs: Runs) -> str:
    """Return the cases, keys that differ first."""
    flat = [_flat(run.case.to_toml_dict()) for run in runs.values()]
    keys = list(dict.fromkeys(key for case in flat for key in case if key != "name"))
    rows = {key: [case.get(key, "-") for case in flat] for key in keys}
    differing = {key: values for key, values in rows.items() if len(set(values)) > 1}
    same = {key: values[:1] for key, values in rows.items() if key not in differing}
    shown = ""
    if differing:
        shown = _table(["key", *runs], [[escape(key), *map(escape, values)] for key, values in differing.items()],
                       "differs")  # fmt: skip
    elif len(runs) > 1:
        shown = _note("The cases are equal.")
    rest = _table(["key", "value"], [[escape(key), *map(escape, values)] for key, values in same.items()])
    what = "What the cases have in common" if len(runs) > 1 else "The case"
    return f"<h2>Setup</h2>{shown}<details><summary>{what}</summary>{rest}</details>"


def _flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    found: dict[str, str] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            found |= _flat(value, f"{prefix}{key}.")
        else:
            found[f"{prefix}{key}"] = f"{value:.6g}" if isinstance(value, float) else json.dumps(value)
    return found


def _charts(runs: Runs) -> list[Chart]:
    """Return title, maker and note of the charts."""
    quantity = _column
    first: list[Chart] = [
        ("Area of the lumen",
         lambda: charts.over_time(runs, {"area": lambda r: 100 * quantity(r, "lumen_area_mean_m2")
                                         / quantity(r, "lumen_area_mean_m2")[0]}, "mean area [% of t = 0]"), ""),
        ("Wall shear stress",
         lambda: charts.over_time(runs, {"computed": lambda r: quantity(r, "sawss_Pa"),
                                         "developed flow": lambda r: quantity(r, "sawss_poiseuille_local_Pa")},
                                  "SAWSS [Pa]", dashed=("developed flow",)),
         "Dashed: developed flow in circles of the same local area, with the same local flow."),
        ("Why it rises", lambda: charts.causes(runs), _causes_note(runs)),
        ("Along the vein: area", lambda: charts.along_vein(runs, "area_z", "_m2", 1e6, "lumen area [mm²]"),
         "Dotted: t = 0."),
        ("Along the vein: wall shear stress",
         lambda: charts.along_vein(runs, "wss_z", "_Pa", 1.0, "WSS, mean around [Pa]"), "Dotted: t = 0."),
        ("Outline of the lumen at mid-length", lambda: charts.outlines(runs), "Grey: t = 0."),
        ("Wall shear stress on the unrolled vein", lambda: charts.unrolled(runs), "At the last time."),
        ("Hydrostatic pressure in the calf", lambda: charts.cut(runs),
         "-tr(sigma)/3, compression positive, at mid-length at the last time; bones and lumen are left out."),
        ("Pressure of the tissue around the vein", lambda: charts.around(runs), _transmission_note(runs)),
    ]  # fmt: skip
    for title, run in runs.items():
        first.append((f"Vein in space: {title}", lambda run=run: charts.vein(run), "Drag to turn; wall shear stress."))  # type: ignore[misc]
        first.append((f"Tissue in space: {title}", lambda run=run: charts.tissue(run),  # type: ignore[misc]
                      "Lower half of the deformed segment, displacement."))  # fmt: skip
    first += [
        ("Flow balance",
         lambda: charts.over_time(runs, {name: lambda r, c=column: 1e6 * quantity(r, c) for name, column in (  # type: ignore[misc]
             ("inflow", "flow_in_m3_s"), ("outflow", "flow_out_m3_s"), ("rate of volume", "lumen_volume_rate_m3_s"))},
             "flow [ml/s]", dashed=("inflow",)), "Inflow = outflow + rate of the lumen's volume."),
        ("Pressure around the vein",
         lambda: charts.over_time(runs, {"tissue side": lambda r: quantity(r, "p_tissue_side_Pa") / 1e3,
                                         "skin": lambda r: quantity(r, "skin_pressure_Pa") / 1e3}, "pressure [kPa]",
                                  dashed=("skin",)),
         "Hydrostatic pressure of the tissue at the outer face of the vein's wall, and pressure on the skin."),
    ]  # fmt: skip
    if stable := {title: run for title, run in runs.items() if run.stability}:
        first.append(("Stability", lambda: charts.stability(stable), _stability_note(stable)))
        for title, run in stable.items():
            first.append((f"Mode of collapse: {title}", lambda run=run: charts.collapse(run),  # type: ignore[misc]
                          "Lower half of the segment, moved along the mode; colour: its relative size."))  # fmt: skip
    return first


def _tube(runs: Runs) -> list[str]:
    """Return the transmural pressure, the tube law, and the runs again in one dimension."""
    shown = [_chart(*one) for one in _tube_charts(runs)]
    try:
        shown.append(_fits(runs))
        compared = _in_one_dimension(runs)
    except (NgfsiError, KeyError) as error:
        return [*shown, f"<h2>In one dimension</h2>{_note(f'Not shown: {error}')}"]
    head = ["run, 1-D against 3-D", *(f"{name}: mean, rms %" for name in ("area", "flow", "SAWSS"))]
    rows = [
        [escape(title), *(f"{100 * gap.mean:+.2f}, {100 * gap.rms:.2f}" for gap in one.gaps.values())]
        for title, one in compared.items()
    ]
    note = (
        "Solid: this run; dashed: mass, momentum, the best tube law against the skin, and unsteady laminar friction "
        "along the vein, with the same loads. Table: gap of the mean over time, and root mean square, over the mean of "
        "the three-dimensional run. Coarse steps damp the swinging of the blood there."
    )
    return [
        *shown,
        _chart("In one dimension", lambda: charts.one_dimension(compared), ""),
        _table(head, rows),
        _note(note),
    ]


def _tube_charts(runs: Runs) -> list[Chart]:
    return [
        ("Along the vein: transmural pressure",
         lambda: charts.along_vein(runs, "p_transmural_z", "_Pa", 1e-3, "transmural pressure [kPa]"),
         "Blood less tissue: its normal traction on the wall, mean around. Dotted: t = 0."),
        ("Tube law", lambda: charts.tube_law(runs), ""),
    ]  # fmt: skip


def _in_one_dimension(runs: Runs) -> dict[str, Comparison]:
    return {title: in_one_dimension(run) for title, run in runs.items()}


def _fits(runs: Runs) -> str:
    head = ["run, law", "against", "A0 at mid-length mm²", "K kPa", "rms error of area %", "largest %"]
    rows = []
    for title, run in runs.items():
        for against in externals(run):
            for name, fits in tube_laws(run, against).items():
                middle = fits[len(fits) // 2].law
                rows.append([escape(f"{title}, {name}"), against, f"{1e6 * float(middle.area):.2f}",
                             f"{float(middle.stiffness) / 1e3:.3f}", f"{100 * overall_error(fits):.3f}",
                             f"{100 * max(one.largest for one in fits):.3f}"])  # fmt: skip
    note = (
        "Laws: linear, T = K (a - 1) with a = A/A0; elastic ring, K (sqrt a - 1), Sherwin et al., J Eng Math 47 "
        "(2003); collapsible, K (a^10 - a^-1.5), Shapiro, J Biomech Eng 99 (1977), Brook et al., J Fluid Mech 396 "
        "(1999). Errors are relative to the computed areas at all stations and times."
    )
    return _table(head, rows) + _note(note)


def _column(run: StoredRun, name: str) -> Any:
    return run.series[name]


def _chart(title: str, make: Callable[[], Any], note: str) -> str:
    try:
        figure = make()
    except (NgfsiError, KeyError) as error:
        missing = error if isinstance(error, NgfsiError) else f"the run holds no {error}"
        return f"<h2>{escape(title)}</h2>{_note(f'Not shown: {missing}')}"
    name = _slug(title)
    config = {"displaylogo": False, "responsive": True, "toImageButtonOptions": {"format": "svg", "filename": name}}
    body = figure.to_html(full_html=False, include_plotlyjs=False, config=config, div_id=name)
    return f"<h2>{escape(title)}</h2>{body}{_note(note) if note else ''}"


def _stability_note(runs: Runs) -> str:
    said = [
        "Critical: where the tangent of tissue and wall, the blood's pressure held, becomes singular on the straight "
        "line through two stages; it is reliable near the dashed line, where the vein collapses."
    ]
    for title, run in runs.items():
        critical, eigenvalue = (
            run.stability[name][-1] for name in ("critical_skin_pressure_Pa", "smallest_eigenvalue_1_s2")
        )
        state = "stable" if eigenvalue > 0 else "not stable"
        where = f", critical {from_si(critical, 'mmHg'):.3g} mmHg" if np.isfinite(critical) else ""
        said.append(f"{title}: {state} at the last stage{where}.")
    return " ".join(said)


def _causes_note(runs: Runs) -> str:
    said = []
    for title, run in runs.items():
        if not set(STAGES.values()) <= set(run.series):
            continue
        row = _loaded(run)
        parts = ", ".join(f"{cause} {values[row]:.4f}" for cause, values in decompose(run.series).items())
        said.append(f"{title} at {run.series['time_s'][row]:.3g} s, in Pa: {parts}.")
    return " ".join(said)


def _transmission_note(runs: Runs) -> str:
    said = ["Dotted: t = 0. Where a bone shields the vein, less arrives."]
    for title, run in runs.items():
        share = transmission(run.series)[_loaded(run)]
        if np.isfinite(share):
            said.append(f"{title}: {100 * share:.0f} % of the rise of the skin's pressure arrives at the wall.")
    return " ".join(said)


def _claims(runs: Runs, claims: Mapping[str, Any]) -> str:
    """Return the printed numbers beside those of runs with the law they are of."""
    rows = []
    for title, run in runs.items():
        law = _law(run)
        if law is None or not claims:
            continue
        row, series = _loaded(run), run.series
        computed = {
            "volume_reduction_percent": 100 * (1 - series["lumen_volume_m3"][row] / series["lumen_volume_m3"][0]),
            "sawss_rise_percent": 100 * (series["sawss_Pa"][row] / series["sawss_Pa"][0] - 1),
            "hydrostatic_pressure_kPa": series["p_wall_side_Pa"][row] / 1e3,
        }
        for key, value in computed.items():
            if law in claims.get(key, {}):
                printed = claims[key][law]
                rows.append([escape(f"{title} ({law}): {key.replace('_', ' ')}"), f"{printed:g}", f"{value:.3g}",
                             f"{value - printed:+.3g}"])  # fmt: skip
    if not rows:
        return ""
    note = f"Printed by {claims.get('citation', 'the source')}; the pressure is computed on the wall's side."
    return (
        f"<h2>Held against the printed numbers</h2>{_table(['claim', 'printed', 'computed', 'gap'], rows)}{_note(note)}"
        f"{_note(_why(runs, claims))}"
    )


def _why(runs: Runs, claims: Mapping[str, Any]) -> str:
    """Return why the printed rises of SAWSS can or cannot follow from the printed losses of volume."""
    said = []
    for title, run in runs.items():
        law, series = _law(run), run.series
        losses, rises = (claims.get(key, {}) for key in ("volume_reduction_percent", "sawss_rise_percent"))
        if law not in losses or law not in rises or not set(STAGES.values()) <= set(series):
            continue
        row, start = _loaded(run), float(series["sawss_Pa"][0])
        parts = {cause: 100 * float(values[row]) / start for cause, values in decompose(series).items()}
        flow = from_si(float(series["flow_in_m3_s"][0]), "ml_s")
        said.append(
            f"{title}: at a constant flow a loss of {losses[law]:g} % raises SAWSS by "
            f"{100 * (narrowing(losses[law] / 100) - 1):.0f} %, not by {rises[law]:g} %; the rest must be blood that "
            f"the vein expels itself and profiles that had no time to develop. With {flow:.3g} ml/s these add "
            f"{parts['squeeze flow']:.0f} and {parts['profile']:.0f} % to the {parts['narrowing']:.0f} % of narrowing; "
            "their share grows as the flow falls (study flow_rate)."
        )
    return " ".join(said)


def _law(run: StoredRun) -> str | None:
    """Return the source's letter for the law of a run's tissue."""
    return {"mooney_rivlin": "M", "neo_hookean": "N"}.get(run.case.materials.law_of("tissue").law)


def _costs(runs: Runs) -> str:
    head = ["run", "unknowns", "elements", "steps", "iterations a step", "factorisations", "seconds", "MB", "solver"]
    rows = []
    for title, run in runs.items():
        found, costs = run.manifest, run.costs
        steps = len(costs.get("step", ()))
        rows.append([
            escape(title), f"{found.get('unknowns', '-')}", f"{found.get('mesh', {}).get('elements', '-')}", f"{steps}",
            f"{costs['iterations'].mean():.1f}" if steps else "-", f"{found.get('factorisations', '-')}",
            f"{found.get('elapsed_s', float('nan')):.0f}", f"{found.get('peak_memory_MB', float('nan')):.0f}",
            escape(str(found.get("linear_solver", "-"))),
        ])  # fmt: skip
    return f"<h2>Costs</h2>{_table(head, rows)}"


def _sources(runs: Runs) -> str:
    used = dict.fromkeys(
        f"{title}: " + ", ".join(f"{name} {version}" for name, version in run.manifest["versions"].items())
        for title, run in runs.items()
    )
    items = "".join(f"<li>{escape(text)}</li>" for text in (*REFERENCES, *used))
    return f"<h2>Sources</h2><ul>{items}</ul>"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], kind: str = "") -> str:
    """Return a table; cells are HTML already."""
    heads = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    lines = "".join(f'<tr class="{kind}">' + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{heads}</tr></thead><tbody>{lines}</tbody></table>"


def _note(text: str) -> str:
    return f'<p class="note">{escape(text)}</p>'
