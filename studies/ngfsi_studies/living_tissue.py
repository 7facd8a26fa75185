"""Do the limits that the source study names, isotropic elastic muscle, one tissue for all, decide its results?

The source guesses that isotropy makes its calf too stiff. Here 25 mmHg press at rest on M and N tissue with fibres, and
with fat, compartments, fascia and skin, around its round vein and an oval one. In time muscle with a published loss
angle is held against an elastic one: SAWSS swings with a period of 0.13 s, so that its value at an instant is unsure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from math import pi, radians, tan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from ngfsi_geometry.calf import Compartments
from ngfsi_geometry.segment import FatLayer

from ngfsi.case import Case
from ngfsi.config.functions import PressureRamp, PressureSmoothRamp
from ngfsi.materials import SolidLaw, load_set
from ngfsi.materials.membrane import Membrane
from ngfsi.materials.solid.directions import ConstantDirection
from ngfsi.materials.solid.humphrey_yin import HumphreyYin
from ngfsi.materials.solid.viscosity import SolidViscosity
from ngfsi.report.tables import markdown_table
from ngfsi.report.terminal import console
from ngfsi.run.estimate import companions
from ngfsi.store.stored import StoredRun
from ngfsi.store.table import write_rows
from ngfsi.study import Outcome, run_cases, write_page
from ngfsi.units import MMHG, Shown
from ngfsi_studies import closing_vein, compare_tissues
from ngfsi_studies.figures import Line, lines
from ngfsi_studies.ramp_shape import swing

FULL, DURATION = 25 * MMHG, 1.0
"""Pressure on the skin (Pa), and time in which it rises (s)."""
TISSUES: dict[str, Any] = {"M": load_set("mooney_rivlin_s1"), "N": load_set("neo_hookean_likely")}
VEINS = {"round": 1.0, "oval": closing_vein.RATIO}
"""Ratio of the axes."""
ALONG = 6.5
"""Young's modulus along the fibres over the shear modulus across them; isotropic tissue has 3. Soleus in vivo: 6.92 and
1.06 kPa (S. Hirsch et al., Magn Reson Med 75 (2016) 1537; gastrocnemius 8.22 and 0.90 kPa)."""
PENNATION = radians(20)
"""Of the fibres against the axis of the leg, towards the back: round, within what muscles of the calf have."""
LOSS = tan(0.253 * pi / 2)
"""Loss over storage modulus of relaxed muscle of the thigh, at all frequencies of a springpot of exponent 0.253
(D. Klatt et al., Phys Med Biol 55 (2010) 6445, between 25 and 62.5 Hz)."""
PERIOD = 0.13
"""Of the swing (s), for which viscosities are chosen."""
WITHOUT = "isotropic"
JUDGED = {"round": (WITHOUT, "plain", "fibres", "mean"), "oval": (WITHOUT,)}
"""By vein, kinds of M tissue whose errors are estimated at rest by companions."""


def reinforced(tissue: SolidLaw, stiffer: float, shear: float = 1.0) -> HumphreyYin:
    """Return a tissue of the same moduli with fibres: W = c3 (I1 - 3) + c1 (l - 1)^2.

    Args:
        stiffer: Young's modulus along the fibres over the shear modulus; 3: there are none.
        shear: factor on the shear modulus.
    """
    modulus = shear * float(tissue.shear_modulus or 0.0)
    way = ConstantDirection(vector=(0.0, -float(np.sin(PENNATION)), float(np.cos(PENNATION))))
    return HumphreyYin(
        c1=(stiffer - 3) * modulus / 2, c2=0.0, c3=modulus / 2, c4=0.0, c5=0.0, K=float(tissue.bulk_modulus or 0.0),
        density=tissue.density, fibres=(way,),
    )  # fmt: skip


def same_mean(stiffer: float) -> float:
    """Return the factor on the shear modulus with which its mean over all directions (Voigt) is that without fibres.

    c1 (l - 1)^2 is c1 (a . e a)^2, whose mean resists shear like a modulus of 2 c1/15.
    """
    return 1 / (1 + (stiffer - 3) / 15)


REGIONS: dict[str, Any] = {
    "geometry.fat": FatLayer(), "geometry.compartments": Compartments(),
    "materials.fat": load_set("fat_likely"),
}  # fmt: skip
SHEETS = tuple(Membrane(on=name) for name in ("skin", "fascia", "interosseous_membrane"))


def kinds(name: str) -> dict[str, tuple[str, dict[str, Any]]]:
    """Return what the tissue of a name is, in words, and the changes of the case, by key."""
    tissue = TISSUES[name]
    return {
        WITHOUT: ("as the source has it", {}),
        "plain": ("polynomial law of its moduli, no fibres", {"materials.tissue": reinforced(tissue, 3.0)}),
        "fibres": ("with fibres added", {"materials.tissue": reinforced(tissue, ALONG)}),
        "mean": ("with fibres, of the same mean", {"materials.tissue": reinforced(tissue, ALONG, same_mean(ALONG))}),
        "fat": ("fat under the skin", REGIONS),
        "sheets": ("fat, skin, fascia and interosseous membrane", {**REGIONS, "materials.membranes": SHEETS}),
    }


VISCOSITIES = ("elastic", "dashpot", "series")


def viscosity(kind: str, modulus: float) -> SolidViscosity | None:
    """Return a viscosity with the loss angle of muscle at the period of the swing, beside a shear modulus (Pa).

    A dashpot alone, or two elements at three times and a third of its frequency, which stiffen what is fast.
    """
    rate = 2 * pi / PERIOD
    if kind == "elastic":
        return None
    if kind == "dashpot":
        return SolidViscosity(kelvin_voigt=LOSS * modulus / rate)
    # storage modulus + (1/10 + 9/10) g, loss 2 (3/10) g
    g = LOSS * modulus / (0.6 - LOSS)
    return SolidViscosity(moduli=(g, g), times=(3 / rate, 1 / (3 * rate)))


class Level(NamedTuple):
    """How finely to compute: mesh and order as of a level of compare_tissues.py, step in time (s), tissues at rest,
    kinds of them that are left out, and which companions tell the errors in time."""

    mesh: compare_tissues.Level
    step: float
    tissues: tuple[str, ...]
    left_out: tuple[str, ...] = ()
    errors: tuple[str, ...] = ("space", "time")


LEVELS = {
    "demo": Level(compare_tissues.COARSE, 0.0125, ("M", "N"), ("fat",), ("time",)),
    "paper": Level(compare_tissues.LEVELS["demo"], 0.005, ("M", "N")),
}
SHAPES = {"linear": PressureRamp, "smooth": PressureSmoothRamp}
STEPS = 5
"""Of the pressure at rest."""


def base(level: Level, **changes: Any) -> Case:
    """Return the calf of the source with M tissue, and a wall that stands any compression."""
    found = compare_tissues.case(compare_tissues.MAIN[0], level.mesh)
    common = {"materials.wall": closing_vein.WALL, "output.fields_every": 0, "output.wall_every": 100_000}
    return found.replace(**{**common, **changes})


def at_rest(level: Level) -> dict[str, Case]:
    """Return the cases of steady states under a rising pressure, and of their companions."""
    found = {}
    for name, (vein, ratio) in product(level.tissues, VEINS.items()):
        for kind, (_, changes) in kinds(name).items():
            if kind in level.left_out:
                continue
            key = f"{name.lower()}-{vein}-{kind}"
            found[key] = base(level, **{
                "name": key, "geometry.aspect_ratio": ratio, "materials.tissue": TISSUES[name],
                "loads.skin_pressure": PressureRamp(final=FULL, duration=DURATION), "time.scheme": "static",
                "time.step": DURATION / STEPS, "time.smallest_step": DURATION / STEPS / 64, "time.end": DURATION,
            }).replace(**changes)  # fmt: skip
    for key in (f"m-{vein}-{kind}" for vein, judged in JUDGED.items() for kind in judged):
        found |= {f"{key}-{error}": case for error, case in companions(found[key]).items()}
    return found


def in_time(level: Level) -> dict[str, Case]:
    """Return the cases of the rise in time, and of the companions of the elastic one."""
    found = {}
    for (shape, curve), kind in product(SHAPES.items(), VISCOSITIES):
        tissue = TISSUES["M"]
        viscous = viscosity(kind, float(tissue.shear_modulus or 0.0))
        key = f"m-{shape}-{kind}"
        found[key] = base(level, **{
            "name": key, "materials.tissue": tissue.replace(viscosity=viscous),
            "loads.skin_pressure": curve(final=FULL, duration=DURATION),
            "time.step": level.step, "time.smallest_step": level.step / 64, "time.end": DURATION,
        })  # fmt: skip
    others = companions(found["m-linear-elastic"])
    return found | {f"m-linear-elastic-{error}": others[error] for error in level.errors}


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Run the study at a level into a folder and return the path of the report."""
    chosen = LEVELS[level]
    path = write_report(level, folder, run_cases(at_rest(chosen) | in_time(chosen), folder, quiet=quiet))
    if not quiet:
        console().print(path.read_text(encoding="utf-8").partition("\n\n")[2].partition("\n\n")[0])
    return path


@dataclass(frozen=True)
class AtRest:
    """A tissue at rest under the full pressure: the loss of volume since there was none, and SAWSS over that then."""

    tissue: str
    vein: str
    kind: str
    loss_1: float
    sawss_ratio_1: float

    @classmethod
    def of(cls, key: str, run: StoredRun) -> AtRest:
        """Return that of a run."""
        tissue, vein, kind = key.split("-")
        return cls(tissue.upper(), vein, kind, loss(run), ratio(run))


@dataclass(frozen=True)
class InTime:
    """A rise in time: at its end loss of volume, SAWSS over that at t = 0, and the swing of the last 0.4 s over it."""

    shape: str
    kind: str
    loss_1: float
    sawss_ratio_1: float
    swing_1: float

    @classmethod
    def of(cls, key: str, run: StoredRun) -> InTime:
        """Return that of a run."""
        _, shape, kind = key.split("-")
        return cls(shape, kind, loss(run), ratio(run), swing(run))


def loss(run: StoredRun) -> float:
    """Return the fraction of the lumen's volume that is lost."""
    volume = run.series["lumen_volume_m3"]
    return float(1 - volume[-1] / volume[0])


def ratio(run: StoredRun) -> float:
    """Return SAWSS at the end over that at t = 0."""
    shear = run.series["sawss_Pa"]
    return float(shear[-1] / shear[0])


Errors = Mapping[str, Mapping[str, float]]
"""By key of the run whose companions tell them, and quantity: sums of the relative differences to the companions; of
the "change" of the loss against that of the same law without fibres its difference among the companions in space."""


def errors_of(done: Mapping[str, StoredRun]) -> Errors:
    """Return the estimated errors."""
    found = {}
    for key in (one for one in done if one.count("-") == 2):
        others = [done[name] for name in (f"{key}-space", f"{key}-time") if name in done]
        if not others:
            continue
        quantities = {"loss": loss, "ratio": ratio} | ({"swing": swing} if "linear" in key else {})
        found[key] = {name: sum(abs(number(other) / number(done[key]) - 1) for other in others)
                      for name, number in quantities.items()}  # fmt: skip
        plain = f"{key.rpartition('-')[0]}-plain"
        if {f"{key}-space", plain, f"{plain}-space"} <= done.keys():
            mine, other = (loss(done[key + of]) / loss(done[plain + of]) for of in ("", "-space"))
            found[key]["change"] = abs(other - mine)
    return found


def error_at_rest(errors: Errors, one: AtRest) -> Mapping[str, float]:
    """Return the errors of a tissue at rest: its own, or those of the nearest that has some."""
    keys = (f"{one.tissue.lower()}-{one.vein}-{one.kind}", f"m-{one.vein}-{WITHOUT}")
    return next((errors[key] for key in keys if key in errors), {})


def write_report(level: str, folder: Path, outcomes: Mapping[str, Outcome]) -> Path:
    """Write report.md, the tables and the figure from what became of the runs, and return the report's path."""
    done = {key: one.run for key, one in outcomes.items() if one.run is not None and not one.failure}
    chosen = LEVELS[level]
    kept = {key: done[key] for key in done if key.count("-") == 2}
    rest = [AtRest.of(key, run) for key, run in kept.items() if key in at_rest(chosen)]
    time = [InTime.of(key, run) for key, run in kept.items() if key in in_time(chosen)]
    errors = errors_of(done)
    for name, rows in (("at_rest", rest), ("in_time", time)):
        if rows:
            write_rows(folder / f"{name}.csv", [asdict(one) for one in rows])
    _draw(kept, folder)
    parts = [
        f"# Living tissue, level `{level}`\n", answer(rest, time, errors),
        "![SAWSS while the pressure rises](rise.png)\n",
        "## At rest under 25 mmHg\n", table_at_rest(rest, errors),
        f"Fibres at {np.degrees(PENNATION):.0f} degrees to the axis of the leg, whose Young's modulus along them is "
        f"{ALONG:g} times the shear modulus across (soleus in vivo, Hirsch et al. 2016; 3 without fibres). Added: the "
        "shear modulus is that of the tissue; of the same mean: the mean over all directions is. Fat of 5 mm, septa, "
        "skin and fasciae as in [regions](../regions.md). Wall of `vein_wall`.\n",
        "## In time, M tissue, round vein\n", table_in_time(time, errors),
        f"Viscosities have a loss modulus of {LOSS:.2f} times the storage modulus (relaxed muscle, Klatt et al. 2010) "
        f"at the period of the swing, {PERIOD:g} s: a dashpot alone, or two Maxwell elements, which make tissue "
        f"{0.6 / (0.6 - LOSS):.1f} times as stiff there. The swing is half the distance of the extremes from a cubic, "
        "in the last 0.4 s, over SAWSS at t = 0.\n",
        "±: the sum of the differences to runs of one order more or less and of twice the step (`ngfsi run --error`), "
        f"{'' if 'space' in chosen.errors else 'in time to the latter alone, '}of M tissue: around the round vein "
        "as the source has it and with the polynomial law, around the oval one and in time as the source has it. "
        "Those of others are taken to be the same in proportion. That of a change is its difference to the change "
        "among companions. Twice the step damps the swing as a viscosity does: its "
        "size is unsure, what a viscosity makes of it is seen on equal steps.\n",
    ]  # fmt: skip
    return write_page(folder, "living_tissue", level, parts, outcomes)


def with_error(value: float, relative: float | None, scale: float = 1.0) -> str:
    """Return a number times a scale with its error, if that is known."""
    if not relative:
        return f"{scale * value:.3g}"
    return closing_vein.with_error(scale * value, abs(scale * value * relative))


def _rest(rest: Sequence[AtRest], tissue: str, vein: str, kind: str) -> AtRest | None:
    return next((one for one in rest if (one.tissue, one.vein, one.kind) == (tissue, vein, kind)), None)


def answer(rest: Sequence[AtRest], time: Sequence[InTime], errors: Errors) -> str:
    """Return what fibres, regions and viscosity change, in sentences."""
    said = []
    for tissue, vein in dict.fromkeys((one.tissue, one.vein) for one in rest):
        found = {kind: _rest(rest, tissue, vein, kind) for kind in kinds(tissue)}
        present = {kind: one for kind, one in found.items() if one}
        if not {WITHOUT, "plain", "fibres", "mean"} <= present.keys():
            continue
        losses = {kind: with_error(one.loss_1, error_at_rest(errors, one).get("loss"), 100)
                  for kind, one in present.items()}  # fmt: skip
        changed = {kind: _change(present[kind], present["plain"], errors) for kind in ("fibres", "mean")}
        said.append(
            f"- **{tissue}, {vein} vein**: it loses {losses[WITHOUT]} % of its volume, {losses['plain']} % with the "
            f"polynomial law of the same moduli. Fibres added to that change the loss by {changed['fibres']} % of "
            f"itself, fibres at the same mean shear modulus by {changed['mean']} %"
            + (f"; with fat it loses {losses['fat']} %" if "fat" in losses else "")
            + (f"; with fat, skin and fasciae {losses['sheets']} %" if "sheets" in losses else "") + "."
        )  # fmt: skip
    said += _verdict(rest)
    by = {(one.shape, one.kind): one for one in time}
    for shape in SHAPES:
        if all((shape, kind) in by for kind in VISCOSITIES):
            elastic, dashpot, series = (by[shape, kind] for kind in VISCOSITIES)
            said.append(
                f"- **{shape.capitalize()} rise**: in the last 0.4 s SAWSS swings by {100 * elastic.swing_1:.1f} % of "
                f"that at t = 0 with elastic tissue, {100 * dashpot.swing_1:.1f} % with a dashpot and "
                f"{100 * series.swing_1:.1f} % with two elements; at the end it is {elastic.sawss_ratio_1:.2f}, "
                f"{dashpot.sawss_ratio_1:.2f} and {series.sawss_ratio_1:.2f} times that at t = 0."
            )
    return "\n".join(said or ["The runs that answer the question failed."]) + "\n"


def _change(one: AtRest, plain: AtRest, errors: Errors) -> str:
    """Return by how many per cent of itself fibres change the loss, with the error of that, if it is known."""
    change = one.loss_1 / plain.loss_1 - 1
    error = errors.get(f"{one.tissue}-{one.vein}-{one.kind}".lower(), {}).get("change")
    if not error:
        return f"{100 * change:+.1f}"
    return ("+" if change > 0 else "") + closing_vein.with_error(100 * change, 100 * error)


def _verdict(rest: Sequence[AtRest]) -> list[str]:
    """Return whether isotropy overestimates the stiffness."""
    changes = [
        (one.loss_1 / plain.loss_1 - 1, one.kind)
        for one in rest
        if one.kind in ("fibres", "mean") and (plain := _rest(rest, one.tissue, one.vein, "plain"))
    ]
    if not changes:
        return []
    added, mean = ([change for change, kind in changes if kind == wanted] for wanted in ("fibres", "mean"))
    first = "stiffer" if max(added) < 0 else "softer" if min(added) > 0 else "partly stiffer, partly softer"
    second = "softer" if min(mean) > 0 else "stiffer" if max(mean) < 0 else "partly softer, partly stiffer"
    return [
        f"- **Does isotropy overestimate the stiffness?** If the constants hold across the fibres, as M's were "
        f"measured, fibres make the calf {first}, by up to "
        f"{100 * max(map(abs, added)):.0f} % of the loss; if they are a mean over directions, {second}, by up to "
        f"{100 * max(map(abs, mean)):.0f} %."
    ]


def table_at_rest(rest: Sequence[AtRest], errors: Errors) -> str:
    """Return all runs at rest."""
    cells = []
    for one in rest:
        error = error_at_rest(errors, one)
        cells.append((f"{one.tissue}, {one.vein}", kinds(one.tissue)[one.kind][0],
                      with_error(one.loss_1, error.get("loss"), 100),
                      with_error(one.sawss_ratio_1, error.get("ratio"))))  # fmt: skip
    return markdown_table(("tissue, vein", "what it is", "loss %", "SAWSS over that without pressure"), cells)


def table_in_time(time: Sequence[InTime], errors: Errors) -> str:
    """Return all runs in time."""
    error = errors.get("m-linear-elastic", {})
    cells = [
        (one.shape, one.kind, with_error(one.loss_1, error.get("loss"), 100),
         with_error(one.sawss_ratio_1, error.get("ratio")), with_error(one.swing_1, error.get("swing"), 100))
        for one in time
    ]  # fmt: skip
    return markdown_table(("rise", "viscosity", "loss %", "SAWSS over that at t = 0", "swing %"), cells)


def _draw(kept: Mapping[str, StoredRun], folder: Path) -> None:
    panels: dict[str, list[Line]] = {}
    for shape, kind in product(SHAPES, VISCOSITIES):
        if run := kept.get(f"m-{shape}-{kind}"):
            series = run.series
            panels.setdefault(f"{shape} rise", []).append(
                Line(kind, series["time_s"], series["sawss_Pa"] / series["sawss_Pa"][0], "-")
            )
    if panels:
        lines(panels, (Shown("time", "s"), Shown("SAWSS over that at t = 0", "1")), folder / "rise.png")
