"""docs/source_study.md, docs/results.md and what README.md says of them, from its printed tables and stored results.

    python -m ngfsi_studies.source_page

Prose is in source_page.md.j2, source_results.md.j2 and source_readme.md.j2, and holds no result: the printed numbers
are in source_tables.toml, the computed ones in the tables that the studies left in docs/. tests/test_source_study.py
fails when the pages are not what this would write.
"""

from __future__ import annotations

import csv
import textwrap
from collections.abc import Iterable, Sequence
from functools import partial
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from ngfsi.analysis.decomposition import STAGES, narrowing
from ngfsi.report.tables import markdown_table
from ngfsi.store.disk import replace_file
from ngfsi.units import from_si, to_si
from ngfsi_studies import calibration, closing_vein, ramp_shape, rigid_veins
from ngfsi_studies.compare_tissues import LEVELS, MAIN
from ngfsi_studies.flow_rate import flow_for
from ngfsi_studies.source import everything, inferred_flow
from ngfsi_studies.tissue_findings import SWING, Row, numerical_errors

ROOT = Path(__file__).parents[2]
DOCS, README = ROOT / "docs", ROOT / "README.md"
PAGE, RESULTS = DOCS / "source_study.md", DOCS / "results.md"
BEGIN = "<!-- from here on written by python -m ngfsi_studies.source_page -->\n"
END = "<!-- up to here -->\n"
TISSUES = dict(zip("MN", MAIN, strict=True))
"""Letter of a tissue in the source -> run of `compare_tissues`."""
NUMBERS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


def page() -> str:
    """Return docs/source_study.md."""
    return _render("source_page.md.j2")


def results() -> str:
    """Return docs/results.md."""
    return _render("source_results.md.j2")


def readme(text: str) -> str:
    """Return README.md with what stands between `BEGIN` and `END` written anew.

    Raises:
        ValueError: the two do not stand in it once each.
    """
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        raise ValueError(f"README.md needs one line '{BEGIN.strip()}' and, after it, one '{END.strip()}'")
    before, _, rest = text.partition(BEGIN)
    return before + BEGIN + _render("source_readme.md.j2") + END + rest.partition(END)[2]


def _render(name: str) -> str:
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), undefined=StrictUndefined, keep_trailing_newline=True,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {"as": _as, "unit": _unit, "range": _range, "word": lambda count: NUMBERS[count]}
    blocks = environment.get_template(name).render(facts()).strip().split("\n\n")
    return "\n\n".join(map(_wrapped, blocks)) + "\n"


def _wrapped(block: str) -> str:
    """Return a paragraph or a list in lines of the project's width; headings, tables and pictures as they are."""
    if block.startswith(("#", "|", "!")):
        return block.strip("\n")
    items = block.replace("\n- ", "\n\n- ").split("\n\n")
    fill = partial(textwrap.fill, width=120, break_long_words=False, break_on_hyphens=False)
    return "\n".join(fill(" ".join(item.split()), subsequent_indent="  " * item.startswith("- ")) for item in items)


def _as(values: Any, form: str, factor: float = 1.0) -> str:
    """Return a number, or several joined by commas and the last by "and", in a format."""
    if isinstance(values, int | float):
        return format(factor * values, form)
    *first, last = [format(factor * value, form) for value in values]
    return f"{', '.join(first)} and {last}" if first else last


def _unit(value: float, unit: str, form: str) -> str:
    return format(from_si(value, unit), form)


def _range(values: Iterable[float], form: str, factor: float = 1.0) -> str:
    found = [factor * value for value in values]
    return f"{min(found):{form}} to {max(found):{form}}"


# ---------------------------------------------------------------- numbers


def stored(name: str) -> list[Row]:
    """Return the rows of a table in docs/, numbers as such."""
    with (DOCS / name).open(encoding="utf-8", newline="") as file:
        return [{key: _value(text) for key, text in row.items()} for row in csv.DictReader(file)]


def _value(text: str) -> Any:
    try:
        return float(text)
    except ValueError:
        return text


def facts() -> dict[str, Any]:
    """Return all that the templates may speak of."""
    ramps = [ramp_shape.Result(**row) for row in stored("ramp_shape/results.csv")]
    paper, demo = ({row["run"]: row for row in stored(f"{level}/results.csv")} for level in ("paper", "demo"))
    closing = {row["key"]: closing_vein.Result(**row) for row in stored("closing_vein/results.csv")}
    printed = everything()
    return {
        "printed": printed,
        "chapter_6": printed["compare_tissues"],
        "veins": printed["rigid_veins"],
        "inferred_flow": inferred_flow(),
        "paper": paper,
        "demo": demo,
        "scheme": LEVELS["paper"].scheme,
        "main": [paper[key] for key in TISSUES.values()],
        "tissues": TISSUES,
        "swing_time": SWING,
        "errors": {level: numerical_errors(level) for level in ("demo", "paper")},
        "ramps": {(r.tissue, r.shape, r.step_s == max(one.step_s for one in ramps)): r for r in ramps},
        "ramp_table": ramp_shape.table(ramps),
        "closing": closing,
        "closing_answer": closing_vein.answer(closing),
        "narrowing": {name: narrowing(loss / 100) - 1
                      for name, loss in printed["compare_tissues"]["volume_reduction_percent"].items()},
        "causes": _causes(demo),
        "sections": _sections(),
        "calibration": _calibration(),
        "shapes": _shapes(),
        "reverse": _reverse(),
        "lumens": _lumens(),
        "recomputed": _recomputed(),
        "flows": _flows(),
        "sensitivity": _sensitivity(),
        "stockings": {row["profile"]: row["least_tawss_Pa"] for row in stored("stocking_design/ranking.csv")},
        "compliance_1_mmHg": to_si(1.0, "mmHg") / paper["m_s1"]["tube_stiffness_Pa"],
        "measured_compliance": next(one for one in printed["measured"] if "compliance_1_mmHg" in one),
    }  # fmt: skip


def _causes(demo: dict[str, Row]) -> str:
    cells = [
        (
            demo[key]["title"], f"{demo[key]['sawss_start_Pa']:.4f}",
            *(f"{demo[key][cause.replace(' ', '_') + '_Pa']:.4f}" for cause in STAGES), f"{demo[key]['sawss_Pa']:.4f}",
        )
        for key in TISSUES.values()
    ]  # fmt: skip
    return markdown_table(("tissue", "at t = 0", *STAGES, "SAWSS"), cells)


def _sections() -> dict[str, Any]:
    """Return means of chapter 3 over the subjects by model and strain, and in how many subjects orderings hold."""
    rows = stored("plane_sections/results.csv")
    found = {
        (model, strain): [row for row in rows if (row["model"], row["strain"]) == (model, strain)]
        for model in "ABC"
        for strain in ("small", "finite")
    }

    def of(column: str, model: str, strain: str = "small") -> list[float]:
        return [row[column] for row in found[model, strain]]

    def above(column: str, higher: str, lower: str, strain: str = "small") -> str:
        pairs = list(zip(of(column, higher, strain), of(column, lower, strain), strict=True))
        return f"{sum(one > other for one, other in pairs)} of {len(pairs)}"

    share = "converged_up_to_share_1"
    return {
        "mean": lambda column, strain="small": [float(np.mean(of(column, model, strain))) for model in "ABC"],
        "above": above,
        "printed": lambda key: [_mean(everything()["plane_sections"][key].get(model)) for model in "ABC"],
        "not_converged": [m for m in "ABC" if min(of(share, m, "finite")) < 1],
    }


def _mean(printed: Any) -> float:
    """Return the mean of what is printed as such, or by subject; not a number where there is nothing."""
    if printed is None:
        return float("nan")
    return float(printed["mean"] if isinstance(printed, dict) else np.mean(printed))


def _calibration() -> dict[str, Any]:
    printed, rows = everything()["calibration"], stored("calibration/results.csv")
    areas = zip(printed["calf_area_ratio_simulated"], printed["calf_area_ratio_measured"], strict=True)
    D = calibration.discrepancies()
    subject, place = (int(i) for i in np.unravel_index(D.argmax(), D.shape))
    return {
        "printed_gaps": [1 - simulated / measured for simulated, measured in areas],
        "gap": max(abs(row["calf_area_gap_1"]) for row in rows),
        "losses": [row["vein_area_loss_1"] for row in rows],
        "printed_losses": [first for first, *_ in printed["area_reduction_simulated_percent"]],
        "errors": [abs(row["K_Pa"] / row["K_true_Pa"] - 1) for row in rows],
        "equilibria": [row["equilibria_1"] for row in rows],
        "zeros": len(D),
        "without_zeros": calibration.without_calibration(),
        "worst": float(D.max()),
        "worst_subject": subject + 1,
        "worst_distance": printed["section_distance_mm"][place + 1],
        "worst_printed": printed["discrepancy_by_distance_percent"]["max"][place],
    }


def _tawss() -> dict[str, dict[int, float]]:
    """Return the computed TAWSS (Pa) of chapter 5 by state and subject."""
    found: dict[str, dict[int, float]] = {}
    for row in stored("rigid_veins/results.csv"):
        found.setdefault(row["state"], {})[int(row["subject"])] = row["wss_mean_Pa"]
    return found


def _shapes() -> dict[str, dict[str, Any]]:
    """Return what chapter 5 comes to with one shape in all veins after compression."""
    said, tawss = everything()["rigid_veins"]["tawss_Pa"], _tawss()
    before, _ = rigid_veins.agreement(tawss["before"], said["mean_before"])
    found = {}
    for shape in rigid_veins.SHAPES:
        rises = np.array([100 * (tawss[shape][k] / value - 1) for k, value in tawss["before"].items()])
        after, _ = rigid_veins.agreement(tawss[shape], said["mean_after"])
        found[shape] = {"rising": int(np.sum(rises > 0)), "of": len(rises), "median": float(np.median(rises)),
                        "before": before, "after": after}  # fmt: skip
    return found


def _reverse() -> list[dict[str, Any]]:
    tawss, said = _tawss(), everything()["rigid_veins"]
    return [
        {
            "subject": subject,
            "without": tawss["before"][subject],
            "tried": [tawss[rigid_veins.reversed_state(size)][subject] for size in rigid_veins.BACKWARD],
            "printed": said["tawss_Pa"]["mean_before"][subject - 1],
        }
        for subject in said["reverse_flow_before"]
    ]


def _lumens() -> dict[str, float]:
    """Return areas of the vein in the images, from its volume and from the printed lumen, and a lumen that fits."""
    chapter, veins = everything()["compare_tissues"], everything()["rigid_veins"]
    area = veins["vein_volume_mm3"]["before"][chapter["subject"] - 1] / veins["segment_length_mm"]
    scale = chapter["area_fsi_to_mri"]
    printed = pi * (chapter["lumen_diameter_mm"] / 2) ** 2 / scale
    return {"images_mm2": area, "printed_mm2": printed, "fitting_mm": 2 * sqrt(scale * area / pi)}


def _recomputed() -> dict[str, Any]:
    """Return statistics of the printed tables of chapter 5, and those of the subject of chapter 6."""
    veins, subject = everything()["rigid_veins"], everything()["compare_tissues"]["subject"] - 1

    def pair(table: str, prefix: str = "") -> Sequence[Any]:
        return [np.array(veins[table][f"{prefix}{when}"]) for when in ("before", "after")]

    shear, flow, volume = pair("tawss_Pa", "mean_"), pair("flow_ml_s"), pair("vein_volume_mm3")
    rises = 100 * (shear[1] / shear[0] - 1)
    return {
        "rise": float(rises.mean()),
        "rising": int(np.sum(rises > 0)),
        "subject_shear": [float(one[subject]) for one in shear],
        "subject_rise": float(rises[subject]),
        "subject_volume": [float(one[subject]) for one in volume],
        "volume": [float(one.mean()) for one in volume],
        "flow_of_changes": float(100 * np.mean(flow[1] / flow[0] - 1)),
        "volume_of_means": float(100 * (volume[1].mean() / volume[0].mean() - 1)),
    }


def _flows() -> dict[str, Any]:
    """Return the mean rises (percent) over the inflow in the wider lumen, and what they say."""
    rows, needed = stored("flow_rate/flow_rate.csv"), everything()["compare_tissues"]["sawss_rise_percent"]
    widest = max(row["lumen_diameter_m"] for row in rows)

    def chosen(tissue: str, coupling: str = "two_way", mesh: str = "as the others") -> dict[float, Row]:
        wanted = (tissue, coupling, widest, mesh)
        keys = ("tissue", "coupling", "lumen_diameter_m", "mesh")
        return {row["inlet_flow_m3_s"]: row for row in rows if tuple(row[key] for key in keys) == wanted}

    mean = "rise_mean_percent"
    rises = {tissue: {flow: row[mean] for flow, row in chosen(tissue).items()} for tissue in TISSUES}
    gaps = [abs(row[mean] / rises[t][q] - 1) for t in TISSUES for q, row in chosen(t, "one_way").items()]
    ((flow, finer),) = chosen("M", mesh="finer").items()
    coarse = chosen("M")[flow]
    ratios = [(100 + coarse[key]) / (100 + finer[key]) for key in (mean, "rise_end_percent")]
    return {
        "ml_s": [from_si(flow, "ml_s") for flow in rises["M"]],
        "rises": {tissue: list(one.values()) for tissue, one in rises.items()},
        "needed_m3_s": {t: flow_for(list(one), list(one.values()), needed[t]) for t, one in rises.items()},
        "errors": [abs(ratio - 1) for ratio in (coarse["loss_1"] / finer["loss_1"], *ratios)],
        "one_way": max(gaps),
    }


def _sensitivity() -> dict[str, Any]:
    runs, effects = stored("sensitivity/runs.csv"), stored("sensitivity/effects.csv")
    loss = {row["factor"]: row["mu_star"] for row in effects if row["result"] == "area_loss_percent"}
    return {
        "runs": len(runs),
        "factors": len(loss),
        "largest": max(row["area_loss_percent"] for row in runs),
        "effects": loss,
        "outside": {row["case"]: row["area_loss_percent"] for row in stored("sensitivity/outside.csv")},
    }


if __name__ == "__main__":
    replace_file(PAGE, page().encode())
    replace_file(RESULTS, results().encode())
    replace_file(README, readme(README.read_text(encoding="utf-8")).encode())
