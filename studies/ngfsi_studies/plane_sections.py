"""Which kinematics closes a vein in a plane section of the calf: plane stress (A), mixed (B) or plane strain (C)?

Repeats chapter 3 of the source study on four synthetic subjects, since its images are not available: what can be
compared is what follows from the models alone, their orderings and sizes. Beyond the study, each model is also computed
at finite strain.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from ngfsi_geometry.calf_section import SUBJECTS, CalfSection, subject
from numpy.typing import NDArray

from ngfsi.case import Case, Conditions, Materials, Output, TimeStepping
from ngfsi.config.functions import PressureConstant, PressureRamp
from ngfsi.materials import CompressibleNeoHookean
from ngfsi.report.tables import markdown_table
from ngfsi.report.terminal import console
from ngfsi.solve.statics import section_case
from ngfsi.store.disk import replace_file
from ngfsi.store.stored import Columns, StoredRun
from ngfsi.store.table import write_rows
from ngfsi.study import Outcome, run_cases
from ngfsi.units import Shown, from_si, to_si
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
LOAD_FACTORS = {"small": (0.5, 1.0), "finite": (0.25, 0.5, 0.625, 0.75, 0.875, 1.0)}
"""Fractions of the loads on the way, which are also the times (s) of a run under ramps; at finite strain the vein
becomes soft on it."""
SMALLEST_STEP = 1 / 64
"""Seconds, and fraction of the loads: where smaller steps fail, too, the equilibrium is taken to end."""
RING, FINER = 200, 2
"""For pictures: points of an outline, and how often a curved triangle is halved."""
SKIN = Shown("pressure on the skin, blood in proportion", "mmHg")


@dataclass(frozen=True)
class Finding:
    """What became of one subject in one model.

    Attributes:
        vein, calf, deep_posterior: reductions of area as fractions of it.
        vein_share: the vein's part of the calf's loss.
        pressure, pressure_wall: mean over the vein's outline on either side, Pa.
        path: fractions of the loads and the vein's reduction of area there; `coarse`: with one order less, if computed.
        softest: at finite strain, the stored stability at these loads.
        failure: why the path ended early, if it did; the numbers are then those of its last state.
        run: for pictures.
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
    path: tuple[tuple[float, float], ...] = ()
    coarse: tuple[tuple[float, float], ...] | None = None
    softest: Columns = field(default_factory=dict)
    failure: str = ""
    run: StoredRun | None = None

    @property
    def settled(self) -> tuple[float, float]:
        """Largest fraction of the loads up to which both orders agree, and the vein's reduction of area there."""
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


def case(geometry: CalfSection, model: str, strain: str) -> Case:
    """Return the case of a model: the study's loads, growing in proportion from nothing at t = 0 to all at 1 s."""
    laws: dict[str, Any] = {
        region: CompressibleNeoHookean(young=1e3 * PRINTED[young], poisson=PRINTED["poisson"], density=DENSITY)
        for region, young in (("tissue", "muscle_young_kPa"), ("wall", "wall_young_kPa"))
    }
    stressed = {"A": geometry.solids, "B": tuple(n for n in geometry.solids if n != "deep_posterior"), "C": ()}
    conditions = Conditions(plane_stress=stressed[model], strain=strain)  # type: ignore[arg-type]
    loads = {"skin_pressure": "skin_pressure_mmHg", "outlet_pressure": "vein_pressure_mmHg"}
    load_factors, finite = LOAD_FACTORS[strain], strain == "finite"
    step = float(np.diff([0.0, *load_factors]).min())
    return section_case(geometry, Materials(**laws), conditions=conditions, name=f"section-{model}-{strain}").replace(
        **{f"loads.{name}": PressureRamp(final=to_si(PRINTED[key], "mmHg"), duration=1.0)
           for name, key in loads.items()},
        time=TimeStepping(scheme="static", step=step, end=load_factors[-1], smallest_step=min(SMALLEST_STEP, step)),
        output=Output(fields_every=int(finite), stability=finite),
    )  # fmt: skip


def cases(level: Level) -> dict[str, Case]:
    """Return the cases of a level by subject, model and strain; `coarse`: with one order less.

    `needed` is plane strain at small strain with all of the blood's pressure from the start.
    """
    found: dict[str, Case] = {}
    for number in level.subjects:
        geometry, lower = section(number, level), section(number, level._replace(order=level.order - 1))
        for model in MODELS:
            found |= {f"{number}_{model}_{strain}": case(geometry, model, strain) for strain in STRAINS}
            found[f"{number}_{model}_coarse"] = case(lower, model, "finite").replace(output=Output(fields_every=0))
        blood = to_si(PRINTED["vein_pressure_mmHg"], "mmHg")
        found[f"{number}_needed"] = case(geometry, "C", "small").replace(
            **{"loads.outlet_pressure": PressureConstant(value=blood), "time.step": 0.5, "time.end": 1.0}
        )
    return found


def find(number: int, model: str, strain: str, outcomes: Mapping[str, Outcome]) -> Finding:
    """Return what became of one subject in one model, as far as its equilibrium could be followed."""
    outcome, coarse = outcomes[f"{number}_{model}_{strain}"], outcomes[f"{number}_{model}_coarse"]
    lower = path(coarse, number, strain) if strain == "finite" else None
    known = Finding(number, model, strain, failure=outcome.failure, path=path(outcome, number, strain), coarse=lower)
    if not known.path or outcome.run is None:
        return known
    whole, rest = subject(number), outcome.run.series["deep_posterior_area_m2"][0]
    last = {name: values[-1] for name, values in _on_path(outcome.run.series, strain).items()}
    lumen = whole.veins[0].lumen.area
    lost = {"lumen": lumen - last["lumen_area_m2"], "skin": whole.skin.area - last["skin_area_m2"]}
    return replace(
        known,
        vein=lost["lumen"] / lumen,
        calf=lost["skin"] / whole.skin.area,
        deep_posterior=1 - last["deep_posterior_area_m2"] / rest,
        vein_share=lost["lumen"] / lost["skin"],
        pressure=last["p_tissue_side_Pa"],
        pressure_wall=last["p_wall_side_Pa"],
        softest=_on_path(outcome.run.stability, strain) if strain == "finite" else {},
        run=outcome.run,
    )


def path(outcome: Outcome, number: int, strain: str) -> tuple[tuple[float, float], ...]:
    """Return fractions of the loads that a run has reached, and the vein's reduction of area there."""
    reached = _on_path(outcome.run.series if outcome.run else {}, strain)
    if not reached:
        return ()
    losses = 1 - reached["lumen_area_m2"] / subject(number).veins[0].lumen.area
    return tuple(zip(map(float, reached["time_s"]), map(float, losses), strict=True))


def _on_path(table: Columns, strain: str) -> Columns:
    """Return the rows of a table at the loads on the way, which steps that were halved lie between."""
    if not table:
        return {}
    rows = np.isclose(table["time_s"][:, None], LOAD_FACTORS[strain], rtol=0, atol=1e-9).any(axis=1)
    return {name: values[rows] for name, values in table.items()} if rows.any() else {}


def pressure_needed(run: StoredRun, reduction: float, lumen: float) -> float:
    """Return the pressure on the skin (Pa) at which small plane strain loses a fraction of the vein's area (m2).

    Displacements are linear in the load and areas quadratic in them: three pressures fix the curve, exactly. Not a
    number if it does not lose that much.
    """
    losses = 1 - run.series["lumen_area_m2"] / lumen
    roots = np.roots(np.polyfit(run.series["skin_pressure_Pa"], losses - reduction, 2))
    return float(min(roots[np.isreal(roots) & (roots.real > 0)].real, default=np.nan))


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Run all subjects in all models and write report.md, results.csv and figures; return the report's path."""
    chosen = LEVELS[level]
    computed = cases(chosen)
    outcomes = run_cases(computed, folder / "runs", processes=len(computed), quiet=quiet)
    findings = [find(n, model, strain, outcomes) for n in chosen.subjects for strain in STRAINS for model in MODELS]
    measured, needed = PRINTED["vein_area_reduction_percent"]["measured"], {}
    for number in chosen.subjects:
        if run := outcomes[f"{number}_needed"].run:
            needed[number] = pressure_needed(run, measured[number - 1] / 100, subject(number).veins[0].lumen.area)
    if not quiet:
        console().print("\n".join(map(_line, findings)))
    return write_report(level, folder, findings, needed)


def write_report(level: str, folder: Path, findings: Sequence[Finding], needed: Mapping[int, float]) -> Path:
    """Write tables, figures and what they mean."""
    write_rows(folder / "results.csv", [_row(f) for f in findings])
    pictures = _figures(folder, findings)
    parts = [
        "# Plane sections of the calf: plane stress, mixed, plane strain",
        f'Level `{level}`. Four synthetic subjects (`type = "calf_section"`) stand in for the four of the source '
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
    whole = to_si(load, "mmHg")
    finite = [f for f in findings if f.strain == "finite" and f.softest]
    for f in finite:
        lumen, stiffness = subject(f.subject).veins[0].lumen, f.softest["softest_stiffness_1"]
        place = [f.softest[f"softest_{axis}_m"][-1] for axis in "xy"]
        away = float(np.linalg.norm(place - lumen.centroid)) / np.sqrt(lumen.area / np.pi)
        full = " / ".join(
            f"{100 * path[-1][1]:.1f}" if path and path[-1][0] == 1 else "none" for path in (f.path, f.coarse or ())
        )
        load_factor, loss = f.settled
        rows.append((
            f"{f.subject}, {f.model}", f"{load * load_factor:.0f}", f"{100 * loss:.1f}",
            full + ("" if f.converged else f" {MARK}"),
            f"{stiffness[-1] / stiffness[0]:.2f}", f"{away:.1f}",
        ))  # fmt: skip
    panels = {
        f"model {model}": [
            Line(f"subject {f.subject}", whole * f.softest["time_s"], f.softest["softest_stiffness_1"])
            for f in finite
            if f.model == model
        ]
        for model in MODELS
    }
    lines(panels, (SKIN, Shown("stiffness of the softest motion over shear", "1")), folder / "softest.png")
    head = ("subject, model", "converged up to, mmHg", "vein loses there, %", "at full load, order k / k - 1, %",
            "softest motion, stiffness over that at the first load", "its place, vein radii from the axis")  # fmt: skip
    positive = min(f.softest["softest_stiffness_1"].min() for f in finite) > 0
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
    load = to_si(PRINTED["skin_pressure_mmHg"], "mmHg")
    panels = {
        f"model {model}": [
            Line(
                f"subject {f.subject}, {f.strain} strain",
                [0.0, *(load * load_factor for load_factor, _ in f.path)],
                [0.0, *(vein for _, vein in f.path)],
                "o-" if f.strain == "finite" else "s--",
            )
            for f in findings
            if f.model == model and f.subject <= DRAWN
        ]
        for model in MODELS
    }
    lines(panels, (SKIN, Shown("loss of the vein's area", "percent")), folder / "load.png")
    return "![loss of area over the load](load.png)\n\nLoss of the vein's area over the load."


def _figures(folder: Path, findings: Sequence[Finding]) -> list[str]:
    first = min(f.subject for f in findings)
    drawn = [f for f in findings if f.subject == first and f.run]
    pictures, geometry = [_paths(folder, findings)], subject(first)
    rest = [outline.resampled(RING) for outline in (geometry.skin, geometry.veins[0].lumen)]
    kinds: dict[str, tuple[Shown, Callable[[Any], NDArray[np.float64]], float]] = {
        "displacement": (Shown("displacement", "mm"), lambda d: np.linalg.norm(d["displacement_m"], axis=1), 12e-3),
        "pressure": (Shown("hydrostatic pressure", "kPa"), lambda d: d["hydrostatic_pressure_Pa"], 8e3),
    }
    surfaces = {
        f"{f.model}, {f.strain} strain": f.run.fields(f.path[-1][0]).extract_surface(
            nonlinear_subdivision=FINER, algorithm="dataset_surface"
        )
        for f in drawn
        if f.run
    }
    for name, (shown, value, most) in kinds.items():
        panels = {
            title: FieldMap(seen.points[:, :2], seen.regular_faces, value(seen.point_data), rest)
            for title, seen in surfaces.items()
        }
        field_maps(panels, shown, folder / f"{name}.png", limits=(0.0, most))
        pictures.append(
            f"![{shown.name}]({name}.png)\n\nSubject {first}: {shown.name}; dashed: skin and lumen at rest."
        )
    return pictures
