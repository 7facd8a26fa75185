"""What is said of the source study: pages against the printed tables and the results that are stored in docs/.

The pages themselves are written from both; of the reports that studies wrote, every table and sentence that can be made
from what is stored is made again.
"""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from ngfsi_studies import (
    calibration,
    compare_tissues,
    flow_rate,
    plane_sections,
    ramp_shape,
    rigid_veins,
    sensitivity,
    source_page,
    tissue_report,
)
from ngfsi_studies.source import claims, everything
from ngfsi_studies.source_page import (
    BEGIN,
    DOCS,
    END,
    PAGE,
    README,
    RESULTS,
    ROOT,
    page,
    readme,
    results,
    stored,
)
from ngfsi_studies.tissue_findings import numerical_errors

from ngfsi.materials import load_set
from ngfsi.study.design import Indices

BY_HAND = [README, ROOT / "CONTRIBUTING.md", *(path for path in DOCS.glob("*.md") if path not in (PAGE, RESULTS))]
"""Pages that are not written by a study alone."""


def report(name: str) -> str:
    return (DOCS / name / "report.md").read_text(encoding="utf-8")


def test_pages_are_what_the_tables_say() -> None:
    """To write them again: python -m ngfsi_studies.source_page."""
    assert PAGE.read_text(encoding="utf-8") == page()
    assert RESULTS.read_text(encoding="utf-8") == results()
    text = README.read_text(encoding="utf-8")
    assert text == readme(text)


def test_a_changed_number_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    """A printed one, or a computed one, that is another in its table makes another page."""
    for changed, kept in (("sawss_rise_percent", "M"), ("volume_reduction_percent", "measured")):
        tables = everything()
        tables["compare_tissues"][changed][kept] += 1
        with monkeypatch.context() as patch:
            patch.setattr(source_page, "everything", lambda tables=tables: tables)
            assert page() != PAGE.read_text(encoding="utf-8")
    rows = stored

    def other(name: str) -> Any:
        found = rows(name)
        return [{**row, "loss_1": row["loss_1"] + 0.001} for row in found] if name == "paper/results.csv" else found

    monkeypatch.setattr(source_page, "stored", other)
    assert page() != PAGE.read_text(encoding="utf-8")
    assert results() != RESULTS.read_text(encoding="utf-8")


def test_numbers_of_the_source_stand_in_written_pages_alone() -> None:
    """Nobody types what it prints: sentences with a number and the word are written from the tables."""
    for path in BY_HAND:
        text = path.read_text(encoding="utf-8")
        if BEGIN in text:
            text = text.partition(BEGIN)[0] + text.partition(END)[2]
        for sentence in re.split(r"(?<=[.:|])\s", text.replace("\n", " ")):
            if re.search(r"\bprint(s|ed)\b", sentence):
                assert not re.search(r"\d+(\.\d+)? ?(%|kPa|Pa|mmHg|ml/s)", sentence), f"{path.name}: {sentence}"


def test_links_lead_somewhere() -> None:
    """Of what is written: files are there, and have the headings that are named."""
    for path, text in ((PAGE, page()), (RESULTS, results()), (README, README.read_text(encoding="utf-8"))):
        for target in re.findall(r"\]\(([^)\s]+)\)", text.replace("\n", " ")):
            if target.startswith("http"):
                continue
            name, _, heading = target.partition("#")
            file = (path.parent / name) if name else path
            assert file.exists(), target
            if heading:
                heads = re.findall(r"^#+ (.*)$", file.read_text(encoding="utf-8"), re.MULTILINE)
                slugs = [re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads]
                assert heading in slugs, target


def test_parameter_sets_are_the_printed_ones() -> None:
    section, chapter = everything()["calibration"], everything()["compare_tissues"]
    for number, bulk in enumerate(section["bulk_modulus_kPa"], start=1):
        law: Any = load_set(f"mooney_rivlin_s{number}")
        assert pytest.approx(1e3 * bulk) == law.K
        assert {name: getattr(law, name) / 1e3 for name in ("c10", "c01", "c11")} == section["mooney_rivlin_kPa"]
    named: Any = load_set("neo_hookean_printed")
    assert {name: getattr(named, name) / 1e3 for name in ("C10", "Kv")} == chapter["neo_hookean_kPa"]
    wall: Any = load_set("vein_wall_source")
    assert wall.young == 1e3 * chapter["wall_young_kPa"]


@pytest.mark.parametrize("level", ["demo", "paper"])
def test_report_of_the_tissues(level: str) -> None:
    rows, text = stored(f"{level}/results.csv"), report(level)
    assert tissue_report.headline(rows, claims(), source_page.TISSUES) in text
    assert tissue_report.results_table(rows) in text
    assert tissue_report.claims_table(rows, claims(), numerical_errors(level)) in text
    assert tissue_report.pattern_table(rows) in text
    assert {row["run"] for row in rows} == set(compare_tissues.LEVELS[level].variants)


def test_report_of_the_rises() -> None:
    results, text = [ramp_shape.Result(**row) for row in stored("ramp_shape/results.csv")], report("ramp_shape")
    assert ramp_shape.answer(results) in text
    assert ramp_shape.table(results) in text
    said = claims()["sawss_rise_percent"]
    assert f"Printed by the source: {said['M']:g} (M) and {said['N']:g} (N) %." in text


def test_report_of_the_rigid_veins() -> None:
    columns = {
        "mean": "wss_mean_Pa",
        "smallest": "wss_min_Pa",
        "largest": "wss_max_Pa",
        "uniform": "wss_uniform_tube_Pa",
    }
    found = [
        rigid_veins.Finding(int(row["subject"]), row["state"], row["volume_m3"], row["flow_m3_s"],
                            **{name: row[column] for name, column in columns.items()})
        for row in stored("rigid_veins/results.csv")
    ]  # fmt: skip
    text = report("rigid_veins")
    for part in (rigid_veins._table, rigid_veins._shapes, rigid_veins._reverse):
        assert part(found) in text


def test_report_of_the_plane_sections() -> None:
    found = []
    for row in stored("plane_sections/results.csv"):
        share, whole = row["converged_up_to_share_1"], row["share_of_load_1"]
        one = plane_sections.Finding(
            int(row["subject"]), row["model"], row["strain"], vein=row["vein_area_reduction_1"],
            calf=row["calf_area_reduction_1"], deep_posterior=row["deep_posterior_area_reduction_1"],
            vein_share=row["vein_share_of_calf_loss_1"], pressure=row["p_tissue_side_Pa"],
            pressure_wall=row["p_wall_side_Pa"], path=((whole, row["vein_area_reduction_1"]),),
        )  # fmt: skip
        found.append(one if share == whole else replace(one, coarse=((whole, np.inf),)))
    text = report("plane_sections")
    assert plane_sections._claims(found) in text
    assert plane_sections.orderings(found) in text
    assert plane_sections._meaning() in text


def test_report_of_the_calibration() -> None:
    assert calibration._statistics() in report("calibration")


def test_report_of_the_flows() -> None:
    found = {}
    for row in stored("flow_rate/flow_rate.csv"):
        point = flow_rate.Point(row["tissue"], row["lumen_diameter_m"], row["inlet_flow_m3_s"], row["coupling"],
                                row["mesh"] == "finer")  # fmt: skip
        parts = {cause: row[f"{cause.replace(' ', '_')}_Pa"] for cause in flow_rate.STAGES}
        ratio = 1 + row["rise_end_percent"] / 100
        moment = SimpleNamespace(loss=row["loss_1"], rise=row["rise_end_percent"], parts=parts, sawss_ratio=ratio)
        found[point] = SimpleNamespace(
            ramp_end=moment, mean_rise=row["rise_mean_percent"], start_sawss=row["sawss_start_Pa"]
        )
    known: Any = found
    text = report("flow_rate")
    for part in (flow_rate._answer, flow_rate._table, flow_rate._errors):
        assert part(known) in text


def test_report_of_the_effects() -> None:
    rows, text = stored("sensitivity/effects.csv"), report("sensitivity")
    for name, result in sensitivity.RESULTS.items():
        mean, width, spread = (
            np.array([row[column] for row in rows if row["result"] == name])
            for column in ("mu_star", "mu_star_half_width", "sigma")
        )
        assert sensitivity.answer(result, Indices(("mu*", "sigma"), mean, width, spread, spread)) in text
    for row in stored("sensitivity/outside.csv"):
        assert f"| {row['case']} | {row['area_loss_percent']:.4g} |" in text
