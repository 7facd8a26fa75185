"""Which kinematics closes a vein in a plane section of the calf: plane stress (A), mixed (B) or plane strain (C)?

Repeats chapter 3 of the source study on four synthetic subjects, since its images are not available: what can be
compared is what follows from the models alone, their orderings and sizes. Beyond the study, each model is also computed
at finite strain.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from ngfsi_geometry.calf_section import SUBJECTS, CalfSection, subject
from scipy.optimize import root_scalar

from ngfsi.case import Case, Conditions, Materials
from ngfsi.errors import SolverError
from ngfsi.materials import CompressibleNeoHookean
from ngfsi.measure.plane import PlaneSectionProbe, SectionMap
from ngfsi.mesh.domain import Domain
from ngfsi.report.tables import markdown_table
from ngfsi.report.terminal import console
from ngfsi.solve.statics import SoftestMode, equilibrium, load_path, section_case, softest_mode
from ngfsi.store.disk import explained, replace_file
from ngfsi.store.table import write_rows
from ngfsi.study import workers
from ngfsi.units import from_si, to_si
from ngfsi_studies.figures import FieldMap, Line, field_maps, lines
from ngfsi_studies.source import tables

PRINTED = tables("plane_sections")

MODELS = {
    "A": "plane stress everywhere",
    "B": "plane strain in the deep posterior compartment, plane stress elsewhere",
    "C": "plane strain everywhere",
}
STRAINS = ("small", "finite")
DENSITY = 1060.0
AGREEMENT = 0.01
"""Reductions of area of two orders that differ by less count as converged."""
DRAWN = 3
"""Subjects up to this number are drawn over the load."""


class Level(NamedTuple):
    """How finely a level computes: polynomial order, factor on the element sizes, subjects."""

    order: int
    sizes: float
    subjects: tuple[int, ...] = tuple(SUBJECTS)


LEVELS = {"demo": Level(3, 1.0), "paper": Level(4, 0.8), "fine": Level(5, 0.6)}
MARK = "\u2020"
"""Stands behind numbers that are not converged."""
SHARES = {"small": (0.5, 1.0), "finite": (0.25, 0.5, 0.625, 0.75, 0.875, 1.0)}
"""Shares of the loads on the way: at finite strain the vein becomes soft on it."""


@dataclass(frozen=True)
class Finding:
    """What became of one subject in one model.

    Attributes:
        vein, calf, deep_posterior: reductions of area as shares of it.
        vein_share: the vein's part of the calf's loss.
        pressure, pressure_wall: mean over the vein's outline on either side, Pa.
        map, outlines: for pictures; outlines of skin and lumen at rest, m.
        path: shares of the loads and the vein's reduction of area there; `coarse`: with one order less, if computed.
        modes: at finite strain, the softest motion at each of these shares.
        failure: why the path ended early, if it did; the numbers are then those of its last state.
    """

    subject: int
    model: str
    strain: str
    vein: float = np.nan
    calf: float = np.nan
    deep_posterior: float = np.nan
    vein_share: float = np.nan
    pressure: float = np.nan
    pressure_wall: float = np.nan
    map: SectionMap | None = None
    outlines: tuple[Any, ...] = ()
    path: tuple[tuple[float, float], ...] = ()
    coarse: tuple[tuple[float, float], ...] | None = None
    modes: tuple[SoftestMode, ...] = ()
    failure: str = ""

    @property
    def settled(self) -> tuple[float, float]:
        """Largest share of the loads up to which both orders agree, and the vein's reduction of area there."""
        both = zip(self.path, self.path if self.coarse is None else self.coarse, strict=False)
        agreeing = takewhile(lambda pair: abs(pair[0][1] - pair[1][1]) < AGREEMENT, both)
        return max((here for here, _ in agreeing), default=(0.0, 0.0))

    @property
    def converged(self) -> bool:
        """Whether the whole path was found, and is the same with the next lower order."""
        return not self.failure and self.settled == self.path[-1]


def section(number: int, level: Level) -> CalfSection:
    """Return a synthetic subject with the mesh of a level."""
    sizes = {
        f"mesh.{k}": level.sizes * getattr(subject(number).mesh, k) for k in ("far_size", "bone_size", "vein_size")
    }
    return subject(number).replace(**sizes, **{"mesh.curving_order": level.order})


def case(geometry: CalfSection, model: str, strain: str, skin: float | None = None) -> Case:
    """Return the case of a model; `skin`: pressure on it (Pa) instead of the study's."""
    laws: dict[str, Any] = {
        region: CompressibleNeoHookean(young=1e3 * PRINTED[young], poisson=PRINTED["poisson"], density=DENSITY)
        for region, young in (("tissue", "muscle_young_kPa"), ("wall", "wall_young_kPa"))
    }
    stressed = {"A": geometry.solids, "B": tuple(n for n in geometry.solids if n != "deep_posterior"), "C": ()}
    return section_case(
        geometry,
        Materials(**laws),
        skin=to_si(PRINTED["skin_pressure_mmHg"], "mmHg") if skin is None else skin,
        blood=to_si(PRINTED["vein_pressure_mmHg"], "mmHg"),
        conditions=Conditions(plane_stress=stressed[model], strain=strain),  # type: ignore[arg-type]
        name=f"section-{model}-{strain}",
    )


def find(number: int, model: str, strain: str, domain: Domain, geometry: CalfSection,
         shares: Sequence[float]) -> Finding:  # fmt: skip
    """Compute one subject in one model, as far as its equilibrium can be followed."""
    path, modes, failure = [], [], ""
    try:
        for share, system in zip(shares, load_path(case(geometry, model, strain), shares, domain), strict=True):
            probe = PlaneSectionProbe(system)
            path.append((share, 1 - probe.enclosed_area("lumen") / geometry.veins[0].lumen.area))
            state = _measures(probe, geometry, domain)
            if strain == "finite":
                modes.append(softest_mode(system))
    except SolverError as error:
        failure = str(error)
    return Finding(
        number, model, strain, path=tuple(path), modes=tuple(modes), failure=failure, **(state if path else {})
    )


def with_less(finding: Finding, domain: Domain, geometry: CalfSection, shares: Sequence[float]) -> Finding:
    """Return a finding together with the path that a lower order gives, on whose domain and geometry that is."""
    coarse: list[tuple[float, float]] = []
    with suppress(SolverError):
        for share, system in zip(
            shares, load_path(case(geometry, finding.model, finding.strain), shares, domain), strict=True
        ):
            loss = 1 - PlaneSectionProbe(system).enclosed_area("lumen") / geometry.veins[0].lumen.area
            coarse.append((share, loss))
    return replace(finding, coarse=tuple(coarse))


def _measures(probe: PlaneSectionProbe, geometry: CalfSection, domain: Domain) -> dict[str, Any]:
    lost = {name: whole - probe.enclosed_area(name) for name, whole in whole_areas(geometry).items()}
    return {
        "vein": lost["lumen"] / geometry.veins[0].lumen.area,
        "calf": lost["skin"] / geometry.skin.area,
        "deep_posterior": 1 - probe.region_area("deep_posterior") / domain.volume("deep_posterior"),
        "vein_share": lost["lumen"] / lost["skin"],
        "pressure": probe.pressure_over("wall_outer", "tissue"),
        "pressure_wall": probe.pressure_over("wall_outer", "wall"),
        "map": probe.sample(),
        "outlines": (probe.moved("skin")[0], probe.moved("lumen")[0]),
    }


def whole_areas(geometry: CalfSection) -> dict[str, float]:
    """Return the areas (m2) that skin and lumen enclose at rest."""
    return {"skin": geometry.skin.area, "lumen": geometry.veins[0].lumen.area}


def pressure_needed(domain: Domain, geometry: CalfSection, reduction: float) -> float:
    """Return the pressure on the skin (Pa) at which small plane strain loses a share of the vein's area."""

    def gap(skin: float) -> float:
        probe = PlaneSectionProbe(equilibrium(case(geometry, "C", "small", skin), domain))
        return 1 - probe.enclosed_area("lumen") / geometry.veins[0].lumen.area - reduction

    guess = to_si(PRINTED["skin_pressure_mmHg"], "mmHg")
    return float(root_scalar(gap, x0=guess, x1=2 * guess, rtol=1e-4).root)


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Compute all subjects in all models and write report.md, results.csv and figures; return the report's path."""
    with explained(folder, "made"):
        folder.mkdir(parents=True, exist_ok=True)
    chosen = LEVELS[level]
    findings: list[Finding] = []
    needed: dict[int, float] = {}
    count = len(chosen.subjects)
    with workers() as pool:
        for number, (found, pressure) in zip(
            chosen.subjects, pool.map(one_subject, chosen.subjects, [chosen] * count, [SHARES] * count), strict=True
        ):
            findings += found
            needed[number] = pressure
            if not quiet:
                console().print("\n".join(map(_line, found)))
    return write_report(level, folder, findings, needed)


def one_subject(number: int, level: Level, shares: Mapping[str, Sequence[float]]) -> tuple[list[Finding], float]:
    """Compute one subject in all models, and the pressure (Pa) that plane strain would need."""
    geometry, lower = section(number, level), section(number, level._replace(order=level.order - 1))
    domain, coarse = Domain.build(geometry), Domain.build(lower)
    found = []
    for strain in STRAINS:
        for model in MODELS:
            one = find(number, model, strain, domain, geometry, shares[strain])
            found.append(with_less(one, coarse, lower, shares[strain]) if strain == "finite" else one)
    measured = PRINTED["vein_area_reduction_percent"]["measured"][number - 1] / 100
    return found, pressure_needed(domain, geometry, measured)


def write_report(level: str, folder: Path, findings: Sequence[Finding], needed: Mapping[int, float]) -> Path:
    """Write tables, figures and what they mean."""
    write_rows(folder / "results.csv", [_row(f) for f in findings])
    pictures = _figures(folder, findings)
    parts = [
        "# Plane sections of the calf: plane stress, mixed, plane strain",
        f"Level `{level}`. Four synthetic subjects (`geometry/calf_section.py`) stand in for the four of the source "
        "study, whose images are not available: numbers of single subjects cannot agree, sizes and orderings can. "
        f"{PRINTED['skin_pressure_mmHg']:g} mmHg on the skin, {PRINTED['vein_pressure_mmHg']:g} mmHg in the vein, "
        f"E = {PRINTED['muscle_young_kPa']:g} kPa (wall {PRINTED['wall_young_kPa']:g} kPa), Poisson ratio "
        f"{PRINTED['poisson']:g}; linear elasticity (small) and, beyond the study, a compressible Neo-Hookean law with "
        "the same initial moduli and follower loads (finite).",
        *(f"- **{model}**: {text}." for model, text in MODELS.items()),
        "## Computed and printed",
        _claims(findings),
        "## Orderings",
        orderings(findings),
        "## Small against finite strain",
        _strains(findings),
        "## Where the vein becomes soft",
        _softness(folder, findings),
        "## Pressure that plane strain would need",
        _needed(needed),
        "## What the numbers say",
        _meaning(),
        "## Pictures",
        *pictures,
        "All numbers: [results.csv](results.csv).",
    ]
    path = folder / "report.md"
    replace_file(path, ("\n\n".join(parts).replace(".\n\n- **", ".\n- **") + "\n").encode())
    return path


def _row(f: Finding) -> dict[str, float | str]:
    return {
        "subject": f.subject, "model": f.model, "strain": f.strain,
        "vein_area_reduction_1": f.vein, "calf_area_reduction_1": f.calf,
        "deep_posterior_area_reduction_1": f.deep_posterior, "vein_share_of_calf_loss_1": f.vein_share,
        "p_tissue_side_Pa": f.pressure, "p_wall_side_Pa": f.pressure_wall,
        "share_of_load_1": f.path[-1][0] if f.path else 0.0, "converged_up_to_share_1": f.settled[0],
        "failure": f.failure,
    }  # fmt: skip


def _line(f: Finding) -> str:
    if f.failure:
        done = f.path[-1] if f.path else (0.0, 0.0)
        return f"{_name(f)}: vein {100 * done[1]:.1f} % at {100 * done[0]:.0f} % of the loads, then {f.failure}"
    return (
        f"{_name(f)}: vein {100 * f.vein:.1f} %, calf {100 * f.calf:.1f} %, {f.pressure / 1e3:.2f} kPa over the "
        "vein's outline"
    )


def _name(f: Finding) -> str:
    return f"subject {f.subject}, model {f.model}, {f.strain} strain"


QUANTITIES: dict[str, tuple[str, float, Callable[[Finding], float]]] = {
    "vein, loss of area, %": ("vein_area_reduction_percent", 100, lambda f: f.vein),
    "calf, loss of area, %": ("calf_area_reduction_percent", 100, lambda f: f.calf),
    "pressure over the vein's outline, tissue side, kPa": ("vein_pressure_kPa", 1e-3, lambda f: f.pressure),
    "the same, wall side, kPa": ("vein_pressure_kPa", 1e-3, lambda f: f.pressure_wall),
    "deep posterior compartment, loss of area, %": ("", 100, lambda f: f.deep_posterior),
    "vein's share of the calf's loss, %": ("", 100, lambda f: f.vein_share),
}


def _claims(findings: Sequence[Finding]) -> str:
    rows = []
    for title, (key, factor, value) in QUANTITIES.items():
        for model in MODELS:
            computed = []
            for strain in STRAINS:
                these = [f for f in findings if (f.model, f.strain) == (model, strain) and not f.failure]
                mark = "" if all(f.converged for f in these) else f" {MARK}"
                computed.append(_spread([factor * value(f) for f in these]) + mark)
            rows.append((title, model, _printed(PRINTED.get(key, {}).get(model)), *computed))
    head = (
        "quantity",
        "model",
        "printed, mean (range or sd)",
        *(f"{strain} strain, mean (range)" for strain in STRAINS),
    )
    measured = PRINTED["vein_area_reduction_percent"]["measured"]
    note = (
        f"\n{MARK}: not converged at full load in some subjects, two orders differ; see 'Where the vein becomes "
        "soft'.\n"
        f"\nMeasured in the study's images: vein {np.mean(measured):.1f} % ({min(measured):g} to {max(measured):g}), "
        f"calf {_printed(PRINTED['calf_area_reduction_percent']['measured'])} %, deep posterior compartment "
        f"{_printed(PRINTED['deep_posterior_area_reduction_measured_percent'])} %; all deep veins together "
        f"{PRINTED['veins_share_of_calf_area_loss_percent']['mean']:g} % of the calf's loss."
    )
    return markdown_table(head, rows) + note


def _spread(values: Sequence[float]) -> str:
    return f"{np.mean(values):.2f} ({min(values):.2f} to {max(values):.2f})" if values else "none"


def _printed(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value['mean']:g} (sd {value['sd']:g})" if isinstance(value, dict) else _spread(value)


def orderings(findings: Sequence[Finding]) -> str:
    """Say for which subjects the study's orderings hold."""
    claims: dict[str, Callable[[dict[str, Finding]], bool]] = {
        "the vein loses more area in B than in A": lambda m: m["B"].vein > m["A"].vein,
        "the pressure over the vein's outline is higher in B than in A": lambda m: m["B"].pressure > m["A"].pressure,
        "the vein loses least in C": lambda m: m["C"].vein < min(m["A"].vein, m["B"].vein),
        "the calf loses least in C": lambda m: m["C"].calf < min(m["A"].calf, m["B"].calf),
        "the calf loses at least five times as much in A as in C": lambda m: m["A"].calf > 5 * m["C"].calf,
    }
    rows = []
    for text, holds in claims.items():
        cells = []
        for strain in STRAINS:
            by_subject = models_by_subject(findings, strain)
            kept = [number for number, models in by_subject.items() if holds(models)]
            cells.append(
                f"{len(kept)} of {len(by_subject)}" + ("" if len(kept) in (0, len(by_subject)) else f": {kept}")
            )
        rows.append((text, *cells))
    note = f"\n{MARK}: counts values that are not converged."
    marks = {s: "" if all(f.converged for f in findings if f.strain == s) else f" {MARK}" for s in STRAINS}
    return markdown_table(("the study's ordering", *(f"holds, {s} strain{marks[s]}" for s in STRAINS)), rows) + (
        note if any(marks.values()) else ""
    )


def models_by_subject(findings: Sequence[Finding], strain: str) -> dict[int, dict[str, Finding]]:
    """Return subject -> model -> finding, of subjects computed in every model."""
    found: dict[int, dict[str, Finding]] = {}
    for f in findings:
        if f.strain == strain and not f.failure:
            found.setdefault(f.subject, {})[f.model] = f
    return {number: models for number, models in found.items() if len(models) == len(MODELS)}


def _strains(findings: Sequence[Finding]) -> str:
    rows = []
    for model in MODELS:
        pairs = [
            (small[model], models[model])
            for number, models in models_by_subject(findings, "finite").items()
            if (small := models_by_subject(findings, "small").get(number))
        ]
        mark = "" if all(b.converged for _, b in pairs) else f" {MARK}"
        rows.append((
            model,
            _spread([100 * (b.vein - a.vein) for a, b in pairs]) + mark,
            _spread([100 * (b.calf - a.calf) for a, b in pairs]) + mark,
            _spread([(b.pressure - a.pressure) / 1e3 for a, b in pairs]) + mark,
        ))  # fmt: skip
    head = ("model", "vein, percentage points", "calf, percentage points", "pressure, kPa")
    text = (
        "\nFinite minus small strain at full load, over the subjects that reach it: mean (range). A calf that loses a "
        "quarter of its area is not at small strain; and where tissue is free to leave the plane the vein becomes soft "
        "under load and closes the faster, which linear elasticity cannot show: see the bends in the figure of its "
        f"loss of area over the load. {MARK}: not converged."
    )
    failed = "".join(f"\n- {_line(f)}" for f in findings if f.failure)
    return markdown_table(head, rows) + text + ("\n" + failed if failed else "")


def _softness(folder: Path, findings: Sequence[Finding]) -> str:
    load, rows = PRINTED["skin_pressure_mmHg"], []
    finite = [f for f in findings if f.strain == "finite" and f.modes]
    for f in finite:
        lumen = subject(f.subject).veins[0].lumen
        away = float(np.linalg.norm(np.array(f.modes[-1].place) - lumen.centroid)) / np.sqrt(lumen.area / np.pi)
        full = " / ".join(
            f"{100 * path[-1][1]:.1f}" if path and path[-1][0] == 1 else "none" for path in (f.path, f.coarse or ())
        )
        share, loss = f.settled
        rows.append((
            f"{f.subject}, {f.model}", f"{load * share:.0f}", f"{100 * loss:.1f}",
            full + ("" if f.converged else f" {MARK}"),
            f"{f.modes[-1].stiffness / f.modes[0].stiffness:.2f}", f"{away:.1f}",
        ))  # fmt: skip
    panels = {
        f"model {model}": [
            Line(f"subject {f.subject}", [load * share for share, _ in f.path], [m.stiffness for m in f.modes], "o-")
            for f in finite
            if f.model == model
        ]
        for model in MODELS
    }
    labels = ("pressure on the skin [mmHg], blood in proportion", "stiffness of the softest motion over shear [1]")
    lines(panels, labels, folder / "softest.png")
    head = ("subject, model", "converged up to, mmHg", "vein loses there, %", "at full load, order k / k - 1, %",
            "softest motion, stiffness over that at the first load", "its place, vein radii from the axis")  # fmt: skip
    positive = min(m.stiffness for f in finite for m in f.modes) > 0
    return (
        "![stiffness of the softest motion](softest.png)\n\n"
        + markdown_table(head, rows)
        + "\nThe softest motion is the lowest eigenvalue of the tangent stiffness against the integral of G grad u : "
        "grad v, G the initial shear modulus: 0 means buckling. "
        + (
            "It stays positive on all paths: no load is a bifurcation, the section has no symmetry to lose. "
            if positive
            else "It reaches 0 on some paths: there the equilibrium is lost. "
        )
        + "Where it falls to a small part of its first value, what the discretisation leaves out moves the vein by as "
        "many times more, and the orders part: converged means that they agree within "
        f"{100 * AGREEMENT:g} percentage points of the vein's area."
    )


def _needed(needed: Mapping[int, float]) -> str:
    values = ", ".join(f"{from_si(value, 'mmHg'):.0f}" for value in needed.values())
    return (
        "In model C at small strain the measured loss of the vein takes "
        f"{values} mmHg on the skin (subjects {', '.join(map(str, needed))}); the study: more than "
        f"{PRINTED['plane_strain_pressure_needed_mmHg']:g} mmHg. Linear elasticity does not know that a vein of no "
        "area cannot close further."
    )


def _meaning() -> str:
    nu, young, p = PRINTED["poisson"], PRINTED["muscle_young_kPa"], to_si(PRINTED["skin_pressure_mmHg"], "mmHg") / 1e3
    strain = 200 * (1 + nu) * (1 - 2 * nu) * p / young
    stress = 200 * (1 - nu) * p / young
    found = PRINTED["calf_area_reduction_percent"]
    measured = found["measured"]["mean"]
    return (
        f"- A disc without bones and vein loses 2 (1 + nu)(1 - 2 nu) p / E = {strain:.2f} % of its area in plane "
        f"strain and 2 (1 - nu) p / E = {stress:.1f} % in plane stress, whatever its size. The printed "
        f"{np.mean(found['C']):.2f} and {found['A']['mean']:g} % are {np.mean(found['C']) / strain:.2f} and "
        f"{found['A']['mean'] / stress:.2f} of that; bones and vein of the synthetic subjects leave more of it. Larger "
        "bones, or a smaller load than stated, would lower both.\n"
        f"- The measured loss of the calf ({measured:g} %) is that of plane strain, the measured loss of the vein is "
        "not: no single choice gives both, at small strain as at finite strain.\n"
        "- Where the tissue's pressure is read matters more than the model: the wall, ten times as stiff, carries a "
        "hoop compression of several kPa."
    )


def _paths(folder: Path, findings: Sequence[Finding]) -> str:
    load = PRINTED["skin_pressure_mmHg"]
    panels = {
        f"model {model}": [
            Line(
                f"subject {f.subject}, {f.strain} strain",
                [0.0, *(load * share for share, _ in f.path)],
                [0.0, *(100 * vein for _, vein in f.path)],
                "o-" if f.strain == "finite" else "s--",
            )
            for f in findings
            if f.model == model and f.subject <= DRAWN
        ]
        for model in MODELS
    }
    lines(
        panels, ("pressure on the skin [mmHg], blood in proportion", "loss of the vein's area [%]"), folder / "load.png"
    )
    return "![loss of area over the load](load.png)\n\nLoss of the vein's area over the load."


def _figures(folder: Path, findings: Sequence[Finding]) -> list[str]:
    first = min(f.subject for f in findings)
    drawn = [f for f in findings if f.subject == first and f.path]
    pictures = [_paths(folder, findings)]
    kinds: dict[str, tuple[str, float, Callable[[SectionMap], Any], tuple[float, float]]] = {
        "displacement": ("displacement [mm]", 1e3, lambda m: m.displacement, (0.0, 12.0)),
        "pressure": ("hydrostatic pressure [kPa]", 1e-3, lambda m: m.pressure, (0.0, 8.0)),
    }
    for name, (label, factor, value, limits) in kinds.items():
        panels = {
            f"{f.model}, {f.strain} strain": FieldMap(
                1e3 * f.map.points, f.map.triangles, factor * value(f.map), [1e3 * ring for ring in f.outlines]
            )
            for f in drawn
            if f.map is not None
        }
        field_maps(panels, label, folder / f"{name}.png", limits=limits)
        pictures.append(f"![{label}]({name}.png)\n\nSubject {first}: {label}; dashed: skin and lumen at rest.")
    return pictures
