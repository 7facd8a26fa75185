"""What Python derives from a state or from a stored run: energies and powers, causes of the shear, averages over time,
stability, and what a `StoredRun` offers."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import fields as members
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ngfsi.analysis.decomposition import decompose
from ngfsi.measure.energy import Energy
from ngfsi.measure.stability import SoftestMode, Stage
from ngfsi.run.observers import volume_fields
from ngfsi.store.fields import COLLAPSE, FieldWriter
from ngfsi.store.folder import RunFolder
from ngfsi.store.stored import StoredRun, mean_over_steps, open_run
from tests import test_estimate, test_refine, test_section_studies
from tests.columns import vessel
from tests.columns.fields import at, deformation, gradient, within
from tests.columns.table import entry, held_by, source
from tests.columns.vessel import BLOOD, TIME, over
from tests.measure import test_branches, test_energy, test_shear_history, test_stability
from tests.output import test_fields, test_folder, test_models

Array = NDArray[np.float64]

ENERGY = "Energy"


@source(ENERGY)
def _energy() -> Mapping[str, float]:
    energy = Energy(vessel.system())
    found = {name: getattr(energy, name)() for name in vars(Energy)
             if not name.startswith("_") and name not in ("powers", "skin_power", "rate")}  # fmt: skip
    before = vessel.system().snapshot()
    powers = energy.powers()  # which begins with the flow that is prescribed at the inlet
    vessel.system().restore(before)
    return {**found, "rate": None, "skin_power": energy.skin_power(powers),
            **{f"powers, {name}": None if name in OTHERS else power for name, power in powers.items()}}  # fmt: skip


OTHERS = ("inlet", "outlet", "blood", "ends")


def stored_energy(law: Any, F: Array) -> Array:
    mu = law.young / 2 / (1 + law.poisson)
    lame = law.young * law.poisson / (1 + law.poisson) / (1 - 2 * law.poisson)
    E = (np.swapaxes(F, -1, -2) @ F - np.eye(3)) / 2
    return np.asarray(lame / 2 * np.trace(E, axis1=-2, axis2=-1) ** 2 + mu * np.sum(E * E, axis=(-2, -1)))


@entry(ENERGY, "stored", "kinetic", "excess", "dissipation", "carried", rel=1e-7)
def _energies() -> Mapping[str, float]:
    """Stored in the shape without stress, of whose volume the present reference is a part."""
    found = dict.fromkeys(("stored", "kinetic"), 0.0)
    domain, size = vessel.system().domain, np.linalg.det(np.eye(3) + vessel.RELAXED)
    for region, law in (("tissue", vessel.TISSUE), ("wall", vessel.WALL)):
        places, weights = within(domain, region)
        found["stored"] += float(stored_energy(law, vessel.elastic(places)) @ weights) * size
        found["kinetic"] += law.density / 2 * float(np.sum(at(vessel.rate, places) ** 2, axis=1) @ weights)
    places, weights = within(domain, "fluid")
    F = deformation(vessel.displacement, places)
    weights = weights * np.linalg.det(F)
    rates, dense = gradient(vessel.velocity, places) @ np.linalg.inv(F), BLOOD.density / 2 * speed(places)
    found["kinetic"] += float(dense @ weights)
    found["excess"] = float(dense * np.trace(rates, axis1=1, axis2=2) @ weights)
    strain = (rates + np.swapaxes(rates, 1, 2)) / 2
    found["dissipation"] = 2 * BLOOD.viscosity * float(np.sum(strain**2, axis=(1, 2)) @ weights)
    found["carried"] = 0.0
    for name, way in (("inlet", -1.0), ("outlet", 1.0)):
        ends, areas, _ = over(name)
        out = areas * np.sign(areas[..., 2:]) * way
        found["carried"] += float(
            np.sum(BLOOD.density / 2 * speed(ends) * np.sum(at(vessel.relative, ends) * out, axis=-1))
        )
    return found


def speed(places: Array) -> Array:
    """Return the square of the blood's."""
    return np.asarray(np.sum(at(vessel.velocity, places) ** 2, axis=-1))


@entry(ENERGY, "powers, on the skin", "powers, in cuff 1", "powers, in cuff 2", "skin_power")
def _powers() -> Mapping[str, float]:
    places, areas, _ = over("skin")
    out = areas * np.sign(np.sum(areas[..., :2] * places[..., :2], axis=-1))[..., None]
    swept, risen = np.sum(at(vessel.rate, places) * out, axis=-1), vessel.risen(places[..., 2])
    found = {
        "powers, on the skin": -vessel.SKIN * swept.sum(),
        "powers, in cuff 1": -vessel.CUFF_1 * np.sum(swept * (1 - risen)),
        "powers, in cuff 2": -vessel.CUFF_2 * np.sum(swept * risen),
    }
    return {**found, "skin_power": sum(found.values())}


held_by(test_energy.test_balance_at_each_instant, ENERGY, "rate", *(f"powers, {name}" for name in OTHERS[:3]))
held_by(test_energy.test_steady_flow_turns_all_power_into_heat, ENERGY, "powers, ends")

CAUSES = "decompose"
COLUMNS = {"sawss_poiseuille_inlet_Pa": (1.0, 1.7), "sawss_poiseuille_local_Pa": (1.1, 2.1),
           "sawss_ellipse_local_Pa": (1.2, 2.4), "sawss_Pa": (1.6, 3.4)}  # fmt: skip


@source(CAUSES)
def _causes() -> Mapping[str, float]:
    found = decompose({name: np.array(values) for name, values in COLUMNS.items()})
    return {name: float(values[-1]) for name, values in found.items()}


@entry(CAUSES, "at t = 0", "narrowing", "squeeze flow", "shape", "profile")
def _parts() -> Mapping[str, float]:
    """Each as much as its column rose more than that before it."""
    return {"at t = 0": 1.6, "narrowing": 0.7, "squeeze flow": 0.3, "shape": 0.2, "profile": 0.6}


HISTORY = "wall_history"


@cache
def two_walls() -> tuple[StoredRun, TemporaryDirectory[str]]:
    """Return a run with the wall at three times, at the last of which its stress is that of before reversed, turned and
    weakened, and half the time as long."""
    place, system = TemporaryDirectory(), vessel.system()
    folder = RunFolder.create(Path(place.name) / "run", system.case)
    writer = FieldWriter(folder.path, system.domain, volume_fields(system))
    sample = vessel.probe().vessels[""].wall.sample(1)
    for time, tangential in ((0.0, sample.tangential), (2.0, sample.tangential), (3.0, later(sample.tangential))):
        writer.write_wall(time, replace(sample, tangential=tangential))
    return open_run(folder.path), place


def later(tangential: Array) -> Array:
    return np.asarray(-0.5 * tangential @ np.array([[0.8, 0.6], [-0.6, 0.8]]))


@source(HISTORY)
def _history() -> Mapping[str, Array]:
    return dict(two_walls()[0].wall_history().point_data.items())


@entry(HISTORY, "TAWSS_Pa", "OSI_1", "RRT_1_Pa", rel=1e-5)
def _averages() -> Mapping[str, Array]:
    """The trapezoidal rule over 2 s and 1 s."""
    first = vessel.probe().vessels[""].wall.sample(1).tangential
    size = 2 * np.linalg.norm(first, axis=1) / 3 + (1 + 0.5) / 2 * np.linalg.norm(first, axis=1) / 3
    vector = np.linalg.norm(2 * first + (first + later(first)) / 2, axis=1) / 3
    return {"TAWSS_Pa": size, "OSI_1": (1 - vector / size) / 2, "RRT_1_Pa": 1 / vector}


held_by(test_shear_history.test_slope_along_a_wall, HISTORY, "TAWSSG_Pa_m")

STABILITY, SOFTEST = "stability.csv", "stability.csv of a plane section"


@source(STABILITY)
def _stability() -> Mapping[str, float]:
    return Stage(pressure=900.0, eigenvalue=-3.0, critical=1700.0, wall_share=0.3).row(TIME)


@entry(STABILITY, "time_s", "skin_pressure_Pa", "smallest_eigenvalue_1_s2", "critical_skin_pressure_Pa",
       "wall_share_of_mode_1")  # fmt: skip
def _stage() -> Mapping[str, float]:
    return {"time_s": TIME, "skin_pressure_Pa": 900.0, "smallest_eigenvalue_1_s2": -3.0,
            "critical_skin_pressure_Pa": 1700.0, "wall_share_of_mode_1": 0.3}  # fmt: skip


@source(SOFTEST)
def _softest() -> Mapping[str, float]:
    return SoftestMode(stiffness=0.25, place=(1e-3, -2e-3)).row(TIME)


@entry(SOFTEST, "time_s", "softest_stiffness_1", "softest_x_m", "softest_y_m")
def _mode() -> Mapping[str, float]:
    return {"time_s": TIME, "softest_stiffness_1": 0.25, "softest_x_m": 1e-3, "softest_y_m": -2e-3}


@source("volume.vtu with the stability")
def _collapse() -> Mapping[str, None]:
    return {COLLAPSE: None}


held_by(test_stability.test_ring_buckles_at_levys_pressure, "volume.vtu with the stability", COLLAPSE)


@source("Stage")
def _of_a_stage() -> Mapping[str, None]:
    return {member.name: None for member in (*members(Stage), *members(SoftestMode))}


held_by(test_stability.test_cuffs_that_press_unevenly, "Stage", "pressure", "eigenvalue")
held_by(test_stability.test_ring_buckles_at_levys_pressure, "Stage", "critical")
held_by(test_stability.test_share_of_the_wall_in_the_mode, "Stage", "wall_share")
held_by(
    test_section_studies.test_softest_motion_scales_with_the_modulus_and_lies_at_the_vein, "Stage", "stiffness", "place"
)

RUN = "StoredRun"


@source(RUN)
def _run() -> Mapping[str, Any]:
    run = vessel.stored()[0]
    names = [name for name, _ in inspect.getmembers(StoredRun) if not name.startswith("_")]
    found: dict[str, Any] = {name: None for name in names if name not in ("vessel", "branch")}
    time = {"time_s": np.array([0.0, 1.0, 4.0]), "x": np.array([50.0, 2.0, 3.0])}
    return found | {
        "skin_pressure": run.skin_pressure, "on_skin": np.array(run.on_skin(TIME)), "along": run.along("area", "m2"),
        "loaded_time": run.loaded_time, "mean_over_steps": mean_over_steps(time, "x"),
        "field_times": np.array(run.field_times()), "lumens": float(run.lumens == {"fluid"}),
    }  # fmt: skip


@entry(RUN, "skin_pressure", "on_skin", "loaded_time", "along", "mean_over_steps", "field_times", "lumens")
def _of_the_run() -> Mapping[str, Any]:
    mean = vessel.on_the_skin()["skin_pressure_mean_Pa"]
    return {"skin_pressure": np.array([mean]), "on_skin": np.array([mean, vessel.SKIN + vessel.CUFF_2]),
            "loaded_time": TIME, "along": vessel.sections()["area"][None], "field_times": np.array([TIME]),
            "mean_over_steps": (1 * 2.0 + 3 * 3.0) / 4, "lumens": 1.0}  # fmt: skip


held_by(test_models.test_largest_load, RUN, "loaded_row")
held_by(test_models.test_two_vessels, RUN, "of_vessel", "vessels", "own_vessel")
held_by(test_branches.test_areas_along_each_branch, RUN, "of_branch")
held_by(test_folder.test_outlines_return_the_rings_of_the_nearest_time, RUN, "outlines")
held_by(test_folder.test_manifest_merges_tables_and_keeps_a_readable_state, RUN, "status", "case")
held_by(test_folder.test_series_is_on_the_disk_after_each_row_and_exact, RUN, "series", "costs", "shape", "stability")
held_by(test_fields.test_fields_are_found_by_time, RUN, "fields")
held_by(test_fields.test_wall_history, RUN, "wall_history")
held_by(test_estimate.test_what_fails_is_told, RUN, "errors")
held_by(test_refine.test_the_state_at_the_end_is_that_of_the_last_row, RUN, "end")
