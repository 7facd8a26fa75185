"""How well does a section say what the tissue is? Registration, bulk modulus and its transfer to other sections.

Repeats chapter 4 of the source study on synthetic subjects whose tissue and motion are known: a pressure on the skin
makes the compressed section, of which only outlines, a few landmarks and the vein's area are handed on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from ngfsi_geometry.calf_section import SUBJECTS, CalfSection, Vein, subject
from numpy.typing import NDArray
from scipy.optimize import brentq

from ngfsi.case import Case, Conditions, Materials
from ngfsi.errors import SolverError
from ngfsi.identify import uniaxial
from ngfsi.identify.section import (
    Calibrated,
    Identified,
    Measure,
    Model,
    area_loss,
    calibrate,
    curve,
    identify,
)
from ngfsi.materials import MooneyRivlin, load_set
from ngfsi.mesh.domain import Domain
from ngfsi.outlines.displacement import OutlineDisplacement, register_outlines
from ngfsi.outlines.outline import Outline, polygon_area
from ngfsi.report.tables import markdown_table
from ngfsi.report.terminal import console
from ngfsi.solve.statics import section_case
from ngfsi.store.disk import explained, replace_file
from ngfsi.store.table import write_rows
from ngfsi.units import Shown, from_si, in_unit
from ngfsi_studies.figures import Line, lines
from ngfsi_studies.source import tables

Array = NDArray[np.float64]

PRINTED = tables("calibration")

BULK = "materials.tissue.K"
FIRST_GUESS = 50e3
LANDMARKS = (0.04, 0.21, 0.38, 0.6, 0.83)
"""Places of landmarks as fractions of the skin's arc length, as superficial veins lie."""
LANDMARK_NOISE = 0.3e-3
"""Standard deviation (m) of their positions: half a pixel of 0.625 mm."""
SEED = 4
MODULI = (5e3, 10e3, 20e3, 40e3, 80e3, 160e3, 320e3, 640e3)
PRESSURE_STEP = 1.25
"""From one trial of a pressure to the next."""


class Level(NamedTuple):
    """How finely a level computes: polynomial order, factor on the element sizes."""

    order: int
    sizes: float


LEVELS = {"demo": Level(2, 1.0), "paper": Level(3, 0.8), "fine": Level(4, 0.6)}


@dataclass(frozen=True)
class Truth:
    """A compressed section that is known: pressure on the skin (Pa), skin and losses of area."""

    model: Model
    pressure: float
    before: Array
    after: Array
    vein: float
    calf: float


@dataclass(frozen=True)
class Recovered:
    """What registration and calibration make of a truth.

    Attributes:
        error_rms, error_max: of the registered displacement of the skin against the truth, m.
        area_gap: compressed area inside the registered skin over that measured, minus 1.
        bulk: calibration of K, with clean and (`noisy`) with noisy landmarks.
        by_section: K by distance (m) from the section and what a K transferred there makes of the vein's area.
    """

    subject: int
    true_bulk: float
    truth: Truth
    error_rms: float
    error_max: float
    noisy_rms: float
    area_gap: float
    bulk: Calibrated
    noisy: Calibrated
    model: Model
    by_section: tuple[tuple[float, float, float], ...]


def section(number: int, level: Level, distance: float = 0.0) -> CalfSection:
    """Return a subject's section at a distance (m) from the main one: the calf tapers, the vein wanders and widens."""
    s = subject(number)
    taper, shift = 1 - 1.5 * distance, distance * np.array([0.10, -0.15])
    lumen = s.veins[0].lumen
    vein = Outline.through(lumen.centroid + shift + (1 + 12 * distance) * (lumen.points - lumen.centroid))
    sizes = {f"mesh.{k}": level.sizes * getattr(s.mesh, k) for k in ("far_size", "bone_size", "vein_size")}
    return s.replace(
        skin=Outline.through(taper * s.skin.points), veins=(Vein(lumen=vein),), **sizes,
        **{"mesh.curving_order": level.order},
    )  # fmt: skip


def materials(bulk: float) -> Materials:
    """Return the tissue of the source study with a bulk modulus (Pa), of which its veins are made, too."""
    law = load_set("mooney_rivlin_s1")
    assert isinstance(law, MooneyRivlin)
    tissue = law.replace(K=bulk, label="Mooney-Rivlin")
    return Materials(tissue=tissue, wall=tissue)


@dataclass(frozen=True)
class Closing:
    """How the printed loss of a vein's area comes about with the printed K, from a pressure on the skin.

    Attributes:
        target: printed loss, as a fraction.
        pressure: on the skin, Pa: where the loss is the printed one, or the largest with an equilibrium.
        vein, calf: losses of area there.
    """

    target: float
    pressure: float
    vein: float
    calf: float

    @property
    def reached(self) -> bool:
        """Whether the vein loses the printed fraction."""
        return self.vein >= self.target


def closing(truth: Truth, target: float) -> Closing:
    """Raise the pressure until the vein loses a fraction of its area, and return the place, interpolated."""
    geometry: CalfSection = truth.model.case.geometry
    before = Closing(target, truth.pressure, truth.vein, truth.calf)
    while not before.reached:
        try:
            probe = truth.model(PRESSURE_STEP * before.pressure)
        except SolverError:
            break
        vein, calf = vein_loss(geometry)(probe), area_loss("skin", geometry.skin.area)(probe)
        now = Closing(target, PRESSURE_STEP * before.pressure, vein, calf)
        if now.reached:
            fraction = (target - before.vein) / (now.vein - before.vein)
            mixed = [a + fraction * (b - a) for a, b in ((before.pressure, now.pressure), (before.calf, now.calf))]
            return Closing(target, mixed[0], target, mixed[1])
        before = now
    return before


def mooney_rivlin(case: Case) -> MooneyRivlin:
    """Return the tissue of a case of this study."""
    assert isinstance(case.materials.tissue, MooneyRivlin)
    return case.materials.tissue


def compressed(geometry: CalfSection, bulk: float, loss: float) -> Truth:
    """Return the section under the pressure at which the calf loses a fraction of its area."""
    case = section_case(geometry, materials(bulk), skin=loss * bulk)
    model = Model(case, ["loads.skin_pressure.value"])
    measure = area_loss("skin", geometry.skin.area)
    found = calibrate(model, measure, loss, loss * bulk)
    probe = model(found.value)
    before, after = probe.moved("skin")
    vein = area_loss("lumen", geometry.veins[0].lumen.area)(probe)
    return Truth(model, found.value, before, after, vein, measure(probe))


def registered(geometry: CalfSection, truth: Truth, noise: float = 0.0) -> OutlineDisplacement:
    """Return the skin's displacement from outlines and landmarks (with noise, m) alone."""
    known = OutlineDisplacement.between(truth.before, truth.after)
    places = geometry.skin.at(geometry.skin.length * np.array(LANDMARKS))
    errors = noise * np.random.default_rng(SEED).standard_normal((len(LANDMARKS), 2))
    return register_outlines(geometry.skin, Outline.through(truth.after), places, places + known(places) + errors)


def moved_by(geometry: CalfSection, displacement: OutlineDisplacement, bulk: float, domain: Domain) -> Model:
    """Return the model of a section whose skin moves as given, as a function of the bulk modulus."""
    conditions = Conditions(skin_displacement=displacement)
    return Model(section_case(geometry, materials(bulk), conditions=conditions), [BULK], domain)


def vein_loss(geometry: CalfSection) -> Measure:
    """Return the measure of the vein's loss of area."""
    return area_loss("lumen", geometry.veins[0].lumen.area)


def recover(number: int, level: Level) -> Recovered:
    """Make a truth of one subject, hand on what images would show, and see what comes back."""
    bulks = 1e3 * np.array(PRINTED["bulk_modulus_by_section_kPa"][number - 1])
    loss = 1 - PRINTED["calf_area_ratio_measured"][number - 1]
    geometry = section(number, level)
    truth = compressed(geometry, bulks[0], loss)
    found, noisy = registered(geometry, truth), registered(geometry, truth, LANDMARK_NOISE)
    exact = truth.after - truth.before
    error, worse = (np.linalg.norm(d(truth.before) - exact, axis=1) for d in (found, noisy))
    model = moved_by(geometry, found, FIRST_GUESS, truth.model.domain)
    bulk = calibrate(model, vein_loss(geometry), truth.vein, FIRST_GUESS)
    shaken = moved_by(geometry, noisy, FIRST_GUESS, truth.model.domain)
    gap = (1 - area_loss("skin", geometry.skin.area)(model(bulk.value))) / (1 - truth.calf) - 1
    return Recovered(
        number, bulks[0], truth, _rms(error), float(error.max()), _rms(worse), gap, bulk,
        calibrate(shaken, vein_loss(geometry), truth.vein, FIRST_GUESS), model,
        tuple(_transferred(number, level, *pair, loss, bulk.value)
              for pair in zip(PRINTED["section_distance_mm"][1:], bulks[1:], strict=True)),
    )  # fmt: skip


def _transferred(
    number: int, level: Level, distance_mm: float, true_bulk: float, loss: float, bulk: float
) -> tuple[float, float, float]:
    """Return distance (mm) and the vein's loss in a section there: simulated with a K from elsewhere, and true."""
    geometry = section(number, level, 1e-3 * distance_mm)
    truth = compressed(geometry, true_bulk, loss)
    model = moved_by(geometry, registered(geometry, truth), bulk, truth.model.domain)
    return distance_mm, vein_loss(geometry)(model(bulk)), truth.vein


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def from_pressure(truth: Truth) -> Identified:
    """Return K and c10 together from the areas of calf and vein under a known pressure, starting 20 % off."""
    case = truth.model.case
    geometry, tissue = case.geometry, mooney_rivlin(case)
    model = Model(case.replace(**{"loads.skin_pressure.value": truth.pressure}), [BULK, "materials.tissue.c10"],
                  truth.model.domain)  # fmt: skip
    measures = {
        "the calf's area": (area_loss("skin", geometry.skin.area), truth.calf),
        "the vein's area": (vein_loss(geometry), truth.vein),
    }
    return identify(model, measures, (1.2 * tissue.K, 1.05 * tissue.c10))


# ---------------------------------------------------------------- the uniaxial test


class Test(NamedTuple):
    """A synthetic uniaxial test: stretches, stresses (Pa) and their fit."""

    title: str
    stretch: Array
    stress: Array
    fit: uniaxial.UniaxialFit


def tests() -> list[Test]:
    """Return synthetic tests of the printed constants: exact, with the printed scatter, and over less strain."""
    law = load_set("mooney_rivlin_s1")
    constants = np.array([law.c10, law.c01, law.c11])  # type: ignore[attr-defined]
    random = np.random.default_rng(SEED)
    made = []
    for title, strain, noise in (
        ("exact, to 30 %", 0.3, 0.0), (f"noise of {PRINTED['fit_rms_Pa']:g} Pa, to 30 %", 0.3, PRINTED["fit_rms_Pa"]),
        ("noise of 10 Pa, to 18 %", 0.18, 10.0), ("noise of 10 Pa, to 5 %", 0.05, 10.0),
    ):  # fmt: skip
        stretch = 1 - np.linspace(strain / 40, strain, 40)
        stress = uniaxial.nominal_stress(stretch, constants) + noise * random.standard_normal(40)
        made.append(Test(title, stretch, stress, uniaxial.fit(stretch, stress)))
    return made


# ---------------------------------------------------------------- statistics of the printed tables


def discrepancies() -> Array:
    """Return D = |a_s - a_m| / a_m in per cent of the printed deformed areas: (subjects, distances 2, 6, 10 mm)."""
    simulated, measured = (
        100 - np.array(PRINTED[f"area_reduction_{name}_percent"]) for name in ("simulated", "measured")
    )
    return np.asarray(100 * np.abs(simulated - measured) / measured)[:, 1:]


def polygon_effect(outline: Outline, points: int) -> float:
    """Return by which fraction the area of a polygon of equally spaced points falls short of the outline's."""
    return 1 - polygon_area(outline.resampled(points)) / outline.area


def shrink_for(outline: Outline, fraction: float) -> float:
    """Return by how much (m) an outline must be moved inwards to lose a fraction of its area."""
    return float(brentq(lambda d: outline.offset(-d).area / outline.area - 1 + fraction, 0.0, 2e-3))


# ---------------------------------------------------------------- report


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Compute everything and write report.md, results.csv and figures; return the report's path."""
    with explained(folder, "made"):
        folder.mkdir(parents=True, exist_ok=True)
    found = []
    for number in SUBJECTS:
        found.append(recover(number, LEVELS[level]))
        if not quiet:
            f = found[-1]
            console().print(
                f"subject {number}: K {f.bulk.value / 1e3:.2f} kPa of {f.true_bulk / 1e3:.2f} kPa in {f.bulk.solves} "
                f"equilibria, skin to {1e3 * f.error_rms:.3f} mm"
            )
    both = from_pressure(found[0].truth)
    return write_report(level, folder, found, both, tests())


def write_report(
    level: str, folder: Path, found: Sequence[Recovered], both: Identified, fits: Sequence[Test]
) -> Path:  # fmt: skip
    """Write tables, figures and what they mean."""
    write_rows(folder / "results.csv", [_row(f) for f in found])
    parts = [
        "# Registration, bulk modulus and its transfer",
        f"Level `{level}`. Four synthetic subjects with the constants and bulk moduli that the source study prints; a "
        "pressure on the skin gives each the loss of calf area that was measured there. Outlines, five landmarks and "
        "the vein's area are handed on, and what comes back is held against the truth. The vein is a hole in tissue.",
        "## Registration and bulk modulus",
        _recovery(found),
        "## Can the number of points explain the smaller area?",
        _points(found[0].model.case.geometry.skin),
        "## Loss of area over the bulk modulus",
        _moduli(folder, found),
        "## What the printed losses of the veins would need",
        _closings(found),
        "## The same bulk modulus in other sections",
        _transfer(found),
        "## The printed statistics, recomputed",
        _statistics(),
        "## Two parameters at once, from the pressure",
        _together(both, found[0]),
        "## Uniaxial test",
        _uniaxial(folder, fits),
        "All numbers: [results.csv](results.csv).",
    ]
    path = folder / "report.md"
    replace_file(path, ("\n\n".join(parts) + "\n").encode())
    return path


def _row(f: Recovered) -> dict[str, float | str]:
    return {
        "subject": f.subject, "K_true_Pa": f.true_bulk, "K_Pa": f.bulk.value, "K_noisy_landmarks_Pa": f.noisy.value,
        "equilibria_1": f.bulk.solves, "skin_pressure_Pa": f.truth.pressure, "vein_area_loss_1": f.truth.vein,
        "calf_area_loss_1": f.truth.calf, "registration_rms_m": f.error_rms, "registration_max_m": f.error_max,
        "registration_noisy_rms_m": f.noisy_rms, "calf_area_gap_1": f.area_gap,
        **{f"vein_loss_{name}_{d:g}mm_1": value for d, *pair in f.by_section
           for name, value in zip(("simulated", "true"), pair, strict=True)},
    }  # fmt: skip


def _recovery(found: Sequence[Recovered]) -> str:
    head = ("subject", "skin, error rms / max, mm", "with noisy landmarks, rms, mm", "calf area against truth, %",
            "K true, kPa", "K found, kPa", "equilibria", "K with noisy landmarks, kPa")  # fmt: skip
    rows = [
        (
            str(f.subject), f"{1e3 * f.error_rms:.3f} / {1e3 * f.error_max:.3f}", f"{1e3 * f.noisy_rms:.3f}",
            f"{100 * f.area_gap:+.4f}", f"{f.true_bulk / 1e3:.2f}", f"{f.bulk.value / 1e3:.2f}", str(f.bulk.solves),
            f"{f.noisy.value / 1e3:.2f}",
        )
        for f in found
    ]  # fmt: skip
    fractions = [s / m - 1 for s, m in _areas()]
    return markdown_table(head, rows) + (
        f"\nNoise: {1e3 * LANDMARK_NOISE:g} mm on each landmark. The study's simulated calf areas are "
        f"{-100 * max(fractions):.2f} to {-100 * min(fractions):.2f} % smaller than the measured ones."
    )


def _areas() -> list[tuple[float, float]]:
    return list(zip(PRINTED["calf_area_ratio_simulated"], PRINTED["calf_area_ratio_measured"], strict=True))


def _points(skin: Outline) -> str:
    few, many = polygon_effect(skin, 400), polygon_effect(skin, 1000)
    loss = float(np.mean([1 - s / m for s, m in _areas()]))
    return (
        f"A polygon of 400 points falls short of the outline's area by {100 * few:.4f} %, one of 1000 points by "
        f"{100 * many:.4f} %: the difference, {100 * (few - many):.4f} %, is {(few - many) / loss:.1%} of the printed "
        f"{100 * loss:.2f} %. It cannot explain it. An outline drawn {1e3 * shrink_for(skin, loss):.2f} mm further "
        f"inside does, {shrink_for(skin, loss) / 0.625e-3:.0%} of a pixel of 0.625 mm: a systematic shift of that "
        "size on one of the two outlines is the likelier reason, and the same in all four subjects."
    )


def _moduli(folder: Path, found: Sequence[Recovered]) -> str:
    drawn, highest = [], []
    for f in found:
        values, losses = curve(f.model, vein_loss(f.model.case.geometry), MODULI)
        drawn.append(Line(f"subject {f.subject}", values, losses))
        highest.append(f"{100 * losses[-1]:.0f} at {in_unit(values[-1], 'kPa', '.0f')}")
    axes = Shown("K", "kPa"), Shown("loss of the vein's area", "percent")
    lines({"vein, skin moved as registered": drawn}, axes, folder / "modulus.png")
    rows = [
        (
            str(f.subject), f"{100 * f.truth.calf:.2f}", f"{f.true_bulk / 1e3:.2f}", f"{100 * f.truth.vein:.1f}",
            f"{PRINTED['area_reduction_simulated_percent'][f.subject - 1][0]:.1f}", most,
            f"{from_si(f.truth.pressure, 'mmHg'):.1f}",
        )
        for f, most in zip(found, highest, strict=True)
    ]  # fmt: skip
    head = ("subject", "calf loses, %", "K printed, kPa", "vein loses with it, %", "printed, %",
            "with the largest K tried, %", "skin pressure at K printed, mmHg")  # fmt: skip
    return (
        "![loss of area over K](modulus.png)\n\n"
        + markdown_table(head, rows)
        + "\nLarger K, larger loss, as in the study. But in these sections the printed K and the printed loss of the "
        "calf's area give the vein far less than the printed loss: under plane strain the calf's loss goes "
        "nearly evenly into all tissue when K is of the order of its shear modulus (7 kPa), and K would have to be far "
        "larger for the vein to take it. The study's displacements are not uniform, its section had more veins, and "
        "its sections are not known: which of these closes the gap cannot be told from the printed numbers. At the "
        "printed K that loss of area takes only a few mmHg on the skin."
    )


def _closings(found: Sequence[Recovered]) -> str:
    rows, ratios = [], []
    for f in found:
        c = closing(f.truth, PRINTED["area_reduction_simulated_percent"][f.subject - 1][0] / 100)
        ratios.append(c.calf / f.truth.calf)
        rows.append((
            str(f.subject), f"{100 * c.target:.1f}", f"{100 * c.vein:.1f}" + ("" if c.reached else " at most"),
            f"{from_si(c.pressure, 'mmHg'):.1f}", f"{100 * c.calf:.1f}", f"{100 * f.truth.calf:.2f}",
            f"{ratios[-1]:.1f}",
        ))  # fmt: skip
    head = ("subject", "vein printed, %", "vein computed, %", "skin pressure, mmHg", "calf loses there, %",
            "calf measured, %", "ratio")  # fmt: skip
    return markdown_table(head, rows) + (
        "\nWith the printed K, the pressure on the skin that closes the vein as printed (or the largest that still has "
        f"an equilibrium) makes the calf lose {min(ratios):.1f} to {max(ratios):.1f} times the measured area. "
        "Printed loss of the vein, printed loss of the calf and printed K do not go together under plane strain in "
        "these sections; a displacement of the skin that is uneven enough to fold the vein, tissue that flows out of "
        "the plane, or empty veins beside this one would have to make up for it."
    )


def _transfer(found: Sequence[Recovered]) -> str:
    head = ("subject", *(f"{d:g} mm: simulated / true, %" for d, *_ in found[0].by_section))
    rows = [(str(f.subject), *(f"{100 * s:.2f} / {100 * t:.2f}" for _, s, t in f.by_section)) for f in found]
    gaps = np.array([[100 * abs((1 - s) / (1 - t) - 1) for _, s, t in f.by_section] for f in found])
    return markdown_table(head, rows) + (
        f"\nThe truth has the bulk moduli that the study refitted in each section. D of the deformed areas is "
        f"{gaps.mean():.2f} % on average ({gaps.max():.2f} % at most), against {without_calibration():.1f} % printed "
        "outside of the sections in which K was found: where a vein loses little, a K that is off by a tenth hardly "
        "shows."
    )


def without_calibration() -> float:
    """Return the printed mean discrepancy (percent) without the sections in which K was found, whose own is 0."""
    sections: int = len(PRINTED["section_distance_mm"])
    return float(PRINTED["discrepancy_overall_percent"]["mean"]) * sections / (sections - 1)


def _statistics() -> str:
    D = discrepancies()
    printed: Mapping[str, Any] = PRINTED["discrepancy_by_distance_percent"]
    rows = [
        (f"{d} mm", *(f"{value:.1f} / {printed[name][k]:g}" for name, value in _summary(D[:, k]).items()))
        for k, d in enumerate(PRINTED["section_distance_mm"][1:])
    ]
    by_subject: Mapping[str, Any] = PRINTED["discrepancy_by_subject_percent"]
    for k in range(len(D)):
        values = _summary(D[k]) | {"mean": float(D[k].mean())}
        cells = [f"{value:.1f} / {by_subject[name][k]:g}" if name in by_subject else f"{value:.1f} / -"
                 for name, value in values.items()]  # fmt: skip
        rows.append((f"subject {k + 1}", *cells))
    overall = PRINTED["discrepancy_overall_percent"]
    with_zero = np.hstack([np.zeros((len(D), 1)), D])
    rows.append(("all", f"{D.max():.1f} / -", f"{D.min():.1f} / -", f"{D.mean():.1f} / {overall['mean']:g}",
                 f"{D.std(ddof=1):.1f} / {overall['sd']:g}"))  # fmt: skip
    means = ", ".join(f"{row.mean():.1f}" for row in with_zero)
    return markdown_table(("D, recomputed / printed, %", "max", "min", "mean", "sd"), rows) + (
        f"\nD = |a_s - a_m| / a_m of the printed deformed areas. Means by subject with the section at 0 mm, whose D is "
        f"0, are {means} %: within 0.1 what the study prints for subjects 1, 2 and 4. Subject 3 at 10 mm gives "
        f"{D[2, 2]:.0f} %, not the printed {by_subject['max'][2]:g} %: one of its two printed losses of area is "
        f"probably misprinted. The printed {overall['mean']:g} % contains the {len(D)} zeros of the sections in which "
        f"K was found: without them it is {without_calibration():.1f} %, and {D.mean():.1f} % with subject 3 at 10 mm "
        "recomputed."
    )


def _summary(values: Array) -> dict[str, float]:
    return {"max": float(values.max()), "min": float(values.min()), "mean": float(values.mean()),
            "sd": float(values.std(ddof=1))}  # fmt: skip


def _together(both: Identified, first: Recovered) -> str:
    tissue = mooney_rivlin(first.truth.model.case)
    return (
        f"From the areas of calf and vein under a known {first.truth.pressure:.0f} Pa on the skin, starting 20 and "
        f"5 % off: K = {both.values[0] / 1e3:.3f} kPa of {tissue.K / 1e3:.3f}, c10 = {both.values[1] / 1e3:.3f} kPa of "
        f"{tissue.c10 / 1e3:.3f}, in {both.solves} equilibria. Correlation of the two {both.correlation[0, 1]:+.3f}; "
        f"an error of 1 % of each loss of area makes {both.uncertainty[0]:.2f} % of K and {both.uncertainty[1]:.2f} % "
        "of c10. The displacement alone cannot give both: without a force only their ratio matters."
    )


def _uniaxial(folder: Path, fits: Sequence[Test]) -> str:
    rows = [
        (t.title, *(f"{c / 1e3:.4g} +- {h / 1e3:.2g}" for c, h in zip(t.fit.constants, t.fit.half_width, strict=True)),
         f"{t.fit.residual:.3g}", f"{t.fit.correlation[0, 1]:.5f}", "yes" if t.fit.told_apart else "no")
        for t in fits
    ]  # fmt: skip
    drawn = []
    for t in fits[1:3]:
        drawn.append(Line(f"{t.title}", 1 - t.stretch, -t.stress, "."))
        fitted = uniaxial.nominal_stress(t.stretch, t.fit.constants)
        drawn.append(Line("its fit", 1 - t.stretch, -fitted, "-"))
    axes = Shown("compression", "percent"), Shown("nominal stress, compression positive", "kPa")
    lines({"Mooney-Rivlin, constants of the study": drawn}, axes, folder / "uniaxial.png")
    head = ("synthetic test", "c10, kPa", "c01, kPa", "c11, kPa", "rms, Pa", "correlation of c10 and c01", "told apart")
    return (
        "![uniaxial test](uniaxial.png)\n\n"
        + markdown_table(head, rows)
        + "\nWith 95 % confidence intervals. "
        + " ".join(f"{t.title}: {t.fit.verdict}." for t in fits[1:])
    )
