"""The figures of compare_tissues.py."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ngfsi.analysis.decomposition import decompose
from ngfsi.report.figures import COLOURS
from ngfsi.report.render import displacement_picture, wall_shear_picture
from ngfsi.store.stored import StoredRun
from ngfsi.units import Shown, in_unit, to_si
from ngfsi_studies.figures import Group, outlines, stacked_series, time_series
from ngfsi_studies.source import claims
from ngfsi_studies.tissue_findings import Finding

GROUPS = {"m_s1": ("m_s2", "m_s3", "m_s4"), "n_likely": (), "m_tenth": (), "n_printed": (), "m_s1_8mm": (),
          "n_likely_8mm": ()}  # fmt: skip
"""Variant drawn as a line -> variants whose range is shaded around it."""

SAWSS = Shown("SAWSS", "Pa")

Files = dict[str, tuple[str, Path | str]]


def draw(findings: Mapping[str, Finding], folder: Path) -> Files:
    """Draw all figures into a folder; return title -> (caption, file or why there is none)."""
    groups = _groups(findings)
    if not groups:
        return {}
    return {**_series(findings, groups, folder), **_shapes(findings, groups, folder)}


def _groups(findings: Mapping[str, Finding]) -> list[Group]:
    groups = []
    for colour, (key, others) in zip(COLOURS, GROUPS.items(), strict=False):
        if finding := findings.get(key):
            band = tuple(findings[other].run for other in others if other in findings)
            groups.append(Group(finding.title, finding.run, band, f"M, K of {len(band) + 1} subjects", colour))
    return groups


def _series(findings: Mapping[str, Finding], groups: list[Group], folder: Path) -> Files:
    full = max(finding.ramp_end.time for finding in findings.values())  # runs that failed ended before
    events = [(full, "full skin pressure")]
    failed = any(finding.failure for finding in findings.values())
    cross = " A cross marks where a run could not go on; it may lie outside of the frame." if failed else ""
    area, ratio = folder / "area.png", folder / "sawss_ratio.png"
    losses = claims()["volume_reduction_percent"]
    printed = [(1 - to_si(losses[name], "percent"), f"{name} as printed") for name in ("M", "N")]
    time_series(groups, _relative("lumen_area_mean_m2"), Shown("mean lumen area", "percent", "of that at t = 0"), area,
                events=events, values=printed)  # fmt: skip
    time_series(groups, _relative("sawss_Pa"), Shown("SAWSS / SAWSS at t = 0", "1"), ratio, events=events)
    files: Files = {"Area of the lumen": (f"Lumen volume over length of the segment.{cross}", area)}
    for lumen in dict.fromkeys(group.run.case.geometry.lumen_diameter for group in groups):
        size = in_unit(lumen, "mm")
        same = [group for group in groups if group.run.case.geometry.lumen_diameter == lumen]
        path = folder / f"sawss_{size.replace(' ', '')}.png"
        time_series(same, lambda run: run.series["sawss_Pa"], SAWSS, path, events=events,
                    comparison=("developed flow of the same local area and flow rate", _developed))  # fmt: skip
        files[f"Wall shear stress, lumen {size}"] = (
            "Solid: computed. Dashed: what developed (Poiseuille) flow would exert with the same local area and flow "
            f"rate; the difference is the velocity profile, which lags behind.{cross}",
            path,
        )
    causes = folder / "sawss_causes.png"
    whole = {f.title: f.run for key, f in findings.items() if key in ("m_s1", "n_likely")}
    if whole:
        stacked_series({title: (run.series["time_s"], decompose(run.series)) for title, run in whole.items()},
                       "computed", SAWSS, causes)  # fmt: skip
        files["Why the wall shear stress rises"] = (
            "SAWSS since t = 0 by cause: narrower sections, the blood that the vein expels itself, sections that are "
            "no circles, and the velocity profile; they sum to the computed value.",
            causes,
        )
    files["Wall shear stress, relative"] = ("SAWSS over its value at t = 0.", ratio)
    return files


def _developed(run: StoredRun) -> Any:
    return run.series["sawss_poiseuille_local_Pa"]


def _shapes(findings: Mapping[str, Finding], groups: list[Group], folder: Path) -> Files:
    last = max(finding.end.time for finding in findings.values())
    whole = {f.title: f.run for key, f in findings.items() if key in ("m_s1", "n_likely") and not f.failure}
    ring, solid, wall = (folder / f"{name}.png" for name in ("outlines", "displacement", "wall_shear"))
    outlines(groups, (0.0, last), ring)
    files: Files = {
        "Cross-section at mid-length": ("Outline of the lumen at t = 0 (grey) and at the last stored time.", ring)
    }
    if whole:
        files["Displacement"] = _picture(
            "Deformed tissue, the same scale for both.", solid, displacement_picture(whole, last, solid)
        )
        files["Wall shear stress on the vein"] = _picture(
            "Before and after; deformed inner wall.", wall, wall_shear_picture(whole, [0.0, last], wall)
        )
    return files


def _picture(caption: str, path: Path, failure: str) -> tuple[str, Path | str]:
    return ("", failure) if failure else (caption, path)


def _relative(column: str) -> Any:
    return lambda run: run.series[column] / run.series[column][0]
