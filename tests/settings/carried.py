"""What the blood carries."""

from __future__ import annotations

from typing import Any

import numpy as np

from ngfsi.case import Case
from ngfsi.measure.scalars import Scalars
from tests.settings.table import Outcome, entry
from tests.transport.test_scalars import MEAN, PIPE, L, R, let_flow
from tests.vein import case_of, system_of


def carried(*tables: dict[str, Any], times: tuple[float, ...] = (0.0, 0.1, 0.2), mean: float = MEAN) -> Scalars:
    """Return scalars that a case file gives, after times (s) of developed flow."""
    case = Case.from_dict({**case_of(PIPE).to_toml_dict(), "scalars": list(tables)})
    scalars = Scalars(system_of(case))
    let_flow(scalars.system, mean)
    for time in times:
        scalars.advance(time)
    return scalars


def measured(column: str, **table: Any) -> float:
    return carried(table).columns()[column]()


@entry("Case.scalars", "ScalarModel.kind", rel=1e-5)
def _scalars() -> Outcome:
    """Blood that was here from the start, but for what has entered within 0.2 s, of half that age."""
    scalars = carried({"kind": "age"}, {"kind": "near_wall", "layer_mm": 1.0})
    found = scalars.columns()
    assert found.keys() == {f"{name}_s" for kind in ("age", "near_wall")
                            for name in (f"{kind}_mean", f"{kind}_max", f"{kind}_outlet")}  # fmt: skip
    through = -scalars.blood.flow.through[scalars.cells.openings["inlet"]].sum() if scalars.blood else 0.0
    volume = sum(volumes.sum() for volumes in scalars.blood.flow.volumes) if scalars.blood else 0.0
    return found["age_mean_s"](), 0.2 - 0.1 * 0.2 * through / volume


@entry("ScalarModel.name")
def _name() -> Outcome:
    return next(iter(carried({"kind": "age", "name": "since_rest"}).columns())), "since_rest_mean_s"


@entry("ScalarModel.diffusivity", rel=1e-9)
def _diffusivity() -> Outcome:
    """A slab that is marked spreads over the rest: the amount stays, and the largest value falls."""
    box = [[-1e3, -1e3, 1e3 * L / 3], [1e3, 1e3, 1e3 * L / 2]]
    table = {"kind": "washout", "corners_mm": box}
    still, spread = (carried(table | {"diffusivity_mm2_s": of}, mean=0.0).columns() for of in (0.0, 0.5))
    assert spread["washout_max_1"]() < 0.95 * still["washout_max_1"]()
    return spread["washout_left_1"](), 1.0


@entry("Washout.start", rel=1e-7)
def _start() -> Outcome:
    """Marked at 0.1 s: in the other 0.1 s as much has left as in the first ones of a run that begins then."""
    later = measured("washout_left_1", kind="washout", start_s=0.1)
    return 1 - later, 1 - carried({"kind": "washout"}, times=(0.0, 0.1)).columns()["washout_left_1"]()


@entry("Washout.corners", rel=1e-9)
def _corners() -> Outcome:
    """Up to the middle of the vein, of which nothing moves yet."""
    box = [[-1e3, -1e3, -1.0], [1e3, 1e3, 1e3 * L / 2]]
    found = carried({"kind": "washout", "corners_mm": box}, times=(0.0,))
    return found.columns()["washout_mean_1"](), 0.5


@entry("Washout.washed_out", rel=1e-3)
def _washed_out() -> Outcome:
    """Before the flow's fastest part reaches the outlet the volume left is 1 - t / t_m."""
    whole = carried({"kind": "washout", "washed_out": 0.25}, times=tuple(np.linspace(0, 0.7, 8)))
    blood = whole.blood
    assert blood is not None
    transit = sum(v.sum() for v in blood.flow.volumes) / blood.flow.through[whole.cells.openings["outlet"]].sum()
    return whole.columns()["washout_time_s"](), 0.25 * transit


@entry("Exposure.constant", "Exposure.stress_power", "Exposure.time_power", rel=1e-9)
def _exposure() -> Outcome:
    """Of D = C tau^a t^b: C times as much, and b and a by what is carried, C^(1/b) tau^(a/b) t, at rest."""
    found = []
    for more in ({"constant": 3.0}, {"stress_power": 2.0, "time_power": 0.904}, {"time_power": 0.904}):
        scalars = carried({"kind": "exposure"}, {"kind": "exposure", "name": "other", **more}, times=(0.0, 1e-6))
        one, other = (scalars.carried[name] for name in ("exposure", "other"))
        blood = scalars.blood
        assert blood is not None
        rates = [np.concatenate([r.ravel() for r in of.model.source(blood)]) for of in (one, other)]
        shown = [of.model.shown(rate) for of, rate in zip((one, other), rates, strict=True)]
        stress = np.concatenate([tau.ravel() for tau in blood.shear_stresses])
        exact = {3.0: 3 * stress, 2.0: stress**2}.get(next(iter(more.values())), stress)
        found.append(float(np.abs(shown[1] / exact - 1).max()))
    return [value < 1e-12 for value in found], [True] * 3


@entry("Exposure.measure", rel=1e-12)
def _measure() -> Outcome:
    """Of published constants the time's power takes effect: D is C (tau t) with that of activation."""
    scalars = carried({"kind": "exposure", "measure": "activation"}, {"kind": "exposure", "name": "lysis",
                      "measure": "lysis"}, times=(0.0, 1e-6))  # fmt: skip
    blood = scalars.blood
    assert blood is not None
    found, stress = [], np.concatenate([tau.ravel() for tau in blood.shear_stresses])
    for name in ("exposure", "lysis"):
        model = scalars.carried[name].model
        found.append(model.shown(np.concatenate([rate.ravel() for rate in model.source(blood)])).max())
    return found, [stress.max() / 3.5, 3.31e-8 * stress.max() ** 3.075]


@entry("NearWall.layer", rel=0.02)
def _layer() -> Outcome:
    """Of blood at rest: a ring."""
    still = carried({"kind": "near_wall", "layer_mm": 1e3 * 0.4 * R}, mean=0.0)
    return still.columns()["near_wall_mean_s"](), 0.2 * (1 - 0.6**2)
