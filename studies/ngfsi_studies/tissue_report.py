"""The report of compare_tissues.py in Markdown: answer first, then figures, claims with reasons, costs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Column, Table

from ngfsi.materials import SaintVenantKirchhoff
from ngfsi.report.tables import markdown_table
from ngfsi.units import from_si
from ngfsi_studies.source import inferred_flow, tables
from ngfsi_studies.tissue_findings import HYDROSTATIC, SWING, Finding, Row

ROUND = (
    "- **The vein is round here.** On the images of the source's subject it lost 58 %; an oval one of the same area, "
    "3.2 : 1, in M tissue loses 58 % under the same pressure: study `closing_vein`.\n"
)
ABBREVIATIONS = (
    "M: Mooney-Rivlin, N: Neo-Hookean tissue; SAWSS: wall shear stress averaged over the deformed inner wall of the "
    "vein; hydrostatic pressure: -tr(sigma)/3, compression positive, at the outer face of the vein wall on the side of "
    "the tissue and on that of the wall, and as a mean over the wall. Losses and rises are relative to the state at "
    "t = 0, in which blood flows steadily at 10 mmHg, rises as (c - u)/u, the formula that the source prints; the mean "
    f"rise is that over the last {SWING:g} s of the ramp."
)


def headline(rows: Sequence[Row], claimed: Mapping[str, Any], main: Mapping[str, str]) -> str:
    """Return the answer in a sentence per tissue; `main`: letter of the tissue -> run."""
    found = {row["run"]: row for row in rows}
    said = []
    for name, key in main.items():
        if not (row := found.get(key)):
            said.append(f"- **{name}** has no result: see the table.")
            continue
        held = row["rise_held_percent"]
        after = f"; once the pressure is held, {held:.0f} % remain" if held != "" else ""
        said.append(
            f"- **{row['title']}**: at {from_si(row['skin_pressure_Pa'], 'mmHg'):.3g} mmHg on the skin the vein has "
            f"lost **{100 * row['loss_1']:.1f} %** of its volume (the source prints "
            f"{claimed['volume_reduction_percent'][name]:g} %) and SAWSS has risen by **{row['rise_percent']:.0f} %** "
            f"(printed: {claimed['sawss_rise_percent'][name]:g} %){after}."
        )
    return "\n".join(said) + "\n"


def results_table(rows: Sequence[Row], missing: Iterable[str] = ()) -> str:
    """Return the main numbers of every run; `missing` are those without a state at t = 0."""
    head = ("tissue", "skin mmHg", "loss %", "loss, unloaded %", "SAWSS t = 0, Pa", "SAWSS ramp end, Pa", "rise %",
            "mean rise %", "rise after hold %", "p tissue kPa", "p wall side kPa", "p wall mean kPa")  # fmt: skip
    cells = [_result(row) for row in rows]
    return markdown_table(head, [*cells, *((title, *["-"] * (len(head) - 1)) for title in missing)])


def notes(findings: Iterable[Finding], missing: Mapping[str, str]) -> str:
    """Return why runs ended early, or have no state at t = 0."""
    said = [
        f"- {f.title} ended early, at {f.end.time:.3g} s and {f.end.skin_mmhg:.3g} mmHg: {f.failure}. "
        + _most_squeezed(f)
        for f in findings
        if f.failure
    ]
    said += [f"- {title} has no state at t = 0: {reason}" for title, reason in missing.items()]
    return "\n".join(said) + "\n" if said else ""


def _most_squeezed(finding: Finding) -> str:
    """Return a sentence on the smallest volume ratios at the end."""
    regions = (*finding.run.case.geometry.solids, *(v.lumen for v in finding.run.case.geometry.vessels if v.lumen))
    ratios = ", ".join(f"{name} {finding.run.series[f'detF_min_{name}_1'][-1]:.2g}" for name in regions)
    return (
        f"Smallest det F in its last state: {ratios}. Saint Venant-Kirchhoff, the law of the wall, softens in "
        "compression and loses stability there: uniaxially at a stretch of 0.58."
        if isinstance(finding.run.case.materials.wall, SaintVenantKirchhoff)
        else f"Smallest det F in its last state: {ratios}."
    )


def _result(row: Row) -> tuple[str, ...]:
    return (
        row["title"],
        f"{from_si(row['skin_pressure_Pa'], 'mmHg'):.3g}",
        f"{100 * row['loss_1']:.1f}",
        f"{100 * row['loss_unloaded_1']:.1f}",
        f"{row['sawss_start_Pa']:.4f}",
        f"{row['sawss_Pa']:.4f}",
        f"{row['rise_percent']:.0f}",
        f"{row['rise_mean_percent']:.0f}",
        "-" if row["rise_held_percent"] == "" else f"{row['rise_held_percent']:.0f}",
        *(f"{from_si(row[f'p_{where}_Pa'], 'kPa'):.2f}" for where in HYDROSTATIC),
    )


CLAIMED = {"m_s1": "M", "n_likely": "N", "n_printed": "N"}
"""Run -> letter of the tissue whose printed numbers it is held against."""


def claims_table(rows: Sequence[Row], claimed: Mapping[str, Any], errors: Mapping[str, float]) -> str:
    """Return each printed number beside the computed one, the numerical error and the number of the reason."""
    head = ("claim", "computed with", "printed", "computed", "gap", "numerical error", "reason")
    found = {row["run"]: row for row in rows}
    cells: list[tuple[str, ...]] = []
    for key, name in CLAIMED.items():
        if row := found.get(key):
            cells += [(claim, row["title"], *rest) for claim, *rest in _claims(row, name, claimed, errors)]
    return markdown_table(head, cells)


def _claims(row: Row, name: str, claimed: Mapping[str, Any], errors: Mapping[str, float]) -> list[tuple[str, ...]]:
    loss, rise, pressure = (
        claimed[key][name] for key in ("volume_reduction_percent", "sawss_rise_percent", "hydrostatic_pressure_kPa")
    )
    lost, wall = 100 * row["loss_1"], from_si(row["p_wall_mean_Pa"], "kPa")
    return [
        (f"{name}: volume reduction, %", f"{loss:g}", f"{lost:.1f}", f"{lost - loss:+.1f}",
         _error("loss", errors), "1"),
        (f"{name}: rise of SAWSS, %", f"{rise:g}", f"{row['rise_percent']:.0f}", f"{row['rise_percent'] - rise:+.0f}",
         _error("sawss", errors), "2"),
        (f"{name}: the same, mean of the last {SWING:g} s", f"{rise:g}", f"{row['rise_mean_percent']:.0f}",
         f"{row['rise_mean_percent'] - rise:+.0f}", _error("mean_sawss", errors), "2"),
        (f"{name}: hydrostatic pressure, mean over the wall, kPa", f"{pressure:g}", f"{wall:.2f}",
         f"{wall - pressure:+.2f}", "not measured", "3"),
    ]  # fmt: skip


def pattern_table(rows: Sequence[Row]) -> str:
    """Return in numbers what the source says of the pattern in words, of runs whose fields are stored."""
    head = ("tissue", "largest displacement mm", "its direction", "between the bones, of it", "SAWSS, distal third",
            "proximal third", "variation along the vein", "least circularity")  # fmt: skip
    cells = [
        (
            row["title"], f"{from_si(row['displacement_m'], 'mm'):.2f}", f"{from_si(row['direction_rad'], 'deg'):.0f}°",
            f"{row['between_bones_1']:.2f}", f"{row['shear_distal_1']:.2f}", f"{row['shear_proximal_1']:.2f}",
            f"{row['shear_variation_1']:.2f}", f"{row['circularity_1']:.3f}",
        )
        for row in rows
        if row["displacement_m"] != ""
    ]  # fmt: skip
    if not cells:
        return ""
    return (
        markdown_table(head, cells)
        + "\nDisplacement of the tissue at the end of the ramp, from the state without load; direction of its place "
        "around the segment: 0° lateral, -90° posterior, ±180° medial. Wall shear stress around stations along the "
        "vein over its mean, distal at the inlet, proximal at the outlet; its variation is the standard deviation over "
        "the mean.\n"
    )


def _error(kind: str, errors: Mapping[str, float]) -> str:
    found = errors.get(f"{kind}_percent")
    names = {"loss": "of the loss", "sawss": "of SAWSS", "mean_sawss": "of SAWSS"}
    return f"{found:.2g} % {names[kind]}" if found is not None else "not measured"


def reasons(findings: Mapping[str, Finding], claimed: Mapping[str, Any]) -> str:
    """Return what the runs show about the gaps, numbered as in the table of claims."""
    volume = _volume_reasons(findings, claimed["volume_reduction_percent"])
    shear = _shear_reasons(findings, claimed["sawss_rise_percent"])
    return "\n".join((*volume, *shear, _pressure_reason(claimed["hydrostatic_pressure_kPa"]))) + "\n"


def _kpa(modulus: float | None) -> float:
    assert modulus is not None  # all laws of this study have one
    return from_si(modulus, "kPa")


def _volume_reasons(findings: Mapping[str, Finding], printed: Mapping[str, float]) -> list[str]:
    lines = [
        "1. **Volume.** The source says neither which bulk modulus M has nor whether its shape is the unloaded one."
    ]
    for key in ("m_s1", "n_likely"):
        if finding := findings.get(key):
            now, law = finding.ramp_end, finding.run.case.materials.law_of("tissue")
            assert law.shear_modulus  # the laws of this study have both moduli
            assert law.bulk_modulus
            lines.append(
                f"   - {finding.title} (initial shear modulus {_kpa(law.shear_modulus):.3g}, bulk modulus "
                f"{_kpa(law.bulk_modulus):.4g} kPa): the blood pressure inflates the unloaded vein by "
                f"{100 * finding.inflation:.1f} %; relative to the unloaded shape the loss is "
                f"{100 * now.loss_unloaded:.1f} % instead of {100 * now.loss:.1f} %."
            )
    subjects = [f.ramp_end.loss for key, f in findings.items() if key.startswith("m_s") and not key.endswith("mm")]
    if len(subjects) > 1:
        lines.append(
            f"   - M over the bulk moduli of the {len(subjects)} subjects: {100 * min(subjects):.1f} to "
            f"{100 * max(subjects):.1f} %."
        )
    if finding := findings.get("n_printed"):
        now, shear = finding.ramp_end, finding.run.case.materials.law_of("tissue").shear_modulus
        assert shear  # the laws of this study have one
        doubt = " and cannot have given the printed loss" if now.loss < printed["N"] / 200 else ""
        lines.append(
            f"   - {finding.title}: {100 * now.loss:.1f} % at {now.skin_mmhg:.3g} mmHg; these constants mean an "
            f"initial shear modulus of {_kpa(shear):.3g} kPa{doubt}."
        )
    if finding := findings.get("m_tenth"):
        now = finding.ramp_end
        lines.append(
            f"   - {finding.title}: {100 * now.loss:.1f} % at {now.skin_mmhg:.3g} mmHg; the constants of a later "
            "review, ten times softer."
        )
    return [*lines, *_lumen_reasons(findings)]


def _lumen_reasons(findings: Mapping[str, Finding]) -> list[str]:
    narrow = [finding for key, finding in findings.items() if key.endswith("8mm")]
    return [
        f"   - {f.title}: {100 * f.ramp_end.loss:.1f} %, and SAWSS starts from {f.start_sawss:.3f} Pa; 8.0 mm is the "
        "lumen that fits the printed flow."
        for f in narrow
    ]


def _shear_reasons(findings: Mapping[str, Finding], printed: Mapping[str, float]) -> list[str]:
    lines = [
        "2. **SAWSS.** Its rise since t = 0 is a sum: narrowing (developed flow of the inlet in the sections as they "
        "are), squeeze flow (the blood that the shrinking vein expels itself), shape (sections that are no circles) "
        "and profile (it has no time to develop within the ramp, nor length at the ends)."
    ]
    for finding in findings.values():
        now, end = finding.ramp_end, finding.end
        after = f"; {end.sawss_ratio:.2f} at {end.time:.3g} s" if finding.held else ""
        lines.append(
            f"   - {finding.title}, in Pa: "
            + " + ".join(f"{value:.4f} ({cause})" for cause, value in now.parts.items())
            + f" = {now.sawss:.4f} at {now.time:.3g} s, {now.sawss_ratio:.2f} times that at t = 0{after}."
        )
    lines += _swing(findings)
    lines.append(
        f"   - {printed['M']:g} and {printed['N']:g} % are rises by the formula that the source prints, (c - u)/u. The "
        f"{printed['rigid_wall_flow']:g} % beside them, of flow in a rigid vein, is the ratio of subject "
        f"{tables('compare_tissues')['subject']}."
    )
    lines.append(
        "   - How the pressure rises within 1 s is not printed: the linear ramp is a choice of this project, and a "
        "smooth rise ends with another SAWSS (study ramp_shape)."
    )
    lines.append(
        f"   - The source prints no flow. {inferred_flow():.3f} ml/s is inferred: the flow of subject "
        f"{tables('compare_tissues')['subject']} before compression, scaled by the areas of model and images. The rise "
        "hangs on it (study flow_rate)."
    )
    return lines


def _swing(findings: Mapping[str, Finding]) -> list[str]:
    periods = {f.title: f.period for f in findings.values() if f.period}
    if not periods:
        return []
    named = ", ".join(f"{period:.2f} s ({title})" for title, period in periods.items())
    return [
        "   - The start of the ramp sets the blood between the given inflow and the given outlet pressure swinging on "
        f"the compliance of the vein, with a period of {named}, and little damps it: SAWSS at one instant depends on "
        "the phase, its mean hardly does. Coarse steps damp it, and a smooth rise hardly excites it."
    ]


def _pressure_reason(printed: Mapping[str, float]) -> str:
    return (
        "3. **Hydrostatic pressure.** The source averages it over the wall of the vein, and so does the table of "
        "claims; on either side of the outer face it is that of the table of results. "
        f"{printed['M']:g} kPa exceeds the load on the skin (3.33 kPa) and even skin and blood together (4.67 kPa): "
        "compression round the circumference of the wall adds to them."
    )


def costs_table(findings: Iterable[Finding]) -> str:
    """Return what each run took, from its manifest and costs."""
    head = ("run", "elements", "unknowns", "steps", "iterations per step", "factorisations", "seconds", "MB", "solver",
            "threads")  # fmt: skip
    return markdown_table(head, (_cost(finding) for finding in findings))


def _cost(finding: Finding) -> tuple[str, ...]:
    manifest, costs = finding.run.manifest, finding.run.costs
    steps = len(costs.get("step", ()))
    iterations = f"{costs['iterations'].mean():.1f}" if steps else "-"
    seconds, memory = (manifest.get(key) for key in ("elapsed_s", "peak_memory_MB"))
    return (
        finding.title,
        str(manifest["mesh"]["elements"]),
        str(manifest["unknowns"]),
        str(steps),
        iterations,
        str(manifest.get("factorisations", "-")),
        "-" if seconds is None else f"{seconds:.0f}",
        "-" if memory is None else f"{memory:.0f}",
        str(manifest.get("linear_solver", "-")),
        str(manifest.get("threads", "-")),
    )


def provenance(findings: Sequence[Finding]) -> str:
    """Return the versions that computed the runs, one line per different set."""
    lines: dict[str, None] = {}
    for finding in findings:
        manifest = finding.run.manifest
        commit = manifest.get("commit")
        state = f"commit {commit['id'][:10]}{' with changes' if commit['dirty'] else ''}" if commit else "no commit"
        text = ", ".join(f"{name} {version}" for name, version in manifest["versions"].items())
        lines.setdefault(f"- {text}; {state}; {manifest['machine']['cpu_count']} processors", None)
    return "\n".join(lines) + "\n"


def pictures(files: Mapping[str, tuple[str, Path | str]]) -> str:
    """Return pictures with captions: title -> (caption, file, or a sentence why there is none)."""
    parts = []
    for title, (caption, file) in files.items():
        shown = f"![{title}]({file.name})" if isinstance(file, Path) else f"*{file}*"
        parts.append(f"### {title}\n\n{shown}\n\n{caption}\n")
    return "\n".join(parts)


def terminal_table(rows: Iterable[Row]) -> Table:
    """Return the main numbers for the terminal."""
    heads = ("skin mmHg", "volume loss %", "SAWSS t = 0, Pa", "SAWSS, Pa", "rise %", "mean rise %")
    table = Table("tissue", *(Column(head, justify="right") for head in heads), title="At the end of the ramp")
    for row in rows:
        title, skin, loss, _, start, sawss, rise, mean = _result(row)[:8]
        table.add_row(title, skin, loss, start, sawss, rise, mean, style="red" if row["failure"] else "")
    return table
