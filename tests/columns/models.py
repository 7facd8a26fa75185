"""What other models measure: solids with a hole, a plane section, a branched vessel; each of flat elements, or closed
forms of what is alike everywhere."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import ngsolve as ng
import numpy as np
from ngfsi_geometry.calf_section import SectionSizes, subject
from numpy.typing import NDArray

from ngfsi.case import Case, Conditions, Cuff, Discretisation, Loads, Materials, TimeStepping
from ngfsi.conditions import WindkesselOpening
from ngfsi.config.functions import PressureConstant
from ngfsi.measure import quantities
from ngfsi.measure.probe import Probe
from ngfsi.mesh.domain import Domain
from ngfsi.system.system import System
from ngfsi.transport.models import Age, Exposure, NearWall, Washout
from tests.columns import fields, vessel
from tests.columns.fields import Field, at, cauchy, cofactor, deformation, on, pressure, within
from tests.columns.table import entry, held_by, source
from tests.runs import row
from tests.transport import test_scalars
from tests.vein import TUBE, case_of, domain_of, value_of

Array = NDArray[np.float64]

STILL = PressureConstant(value=0.0)
STATIC = TimeStepping(scheme="static", step=1.0, end=1.0)
SKIN, INSIDE, IN_CUFF = 300.0, 1150.0, 900.0


def state(case: Case, displacement: Field, relaxed: Array) -> Probe:
    """Return what is measured of solids that are displaced, and free of stress where a linear field leads."""
    system = System(case, domain_of(case.geometry))
    place = (ng.x, ng.y, ng.z)[: system.domain.mesh.dim]
    system.motion.Set(ng.CF(displacement(*place)))
    assert system.relaxation is not None
    system.relaxation.Set(ng.CF(tuple(relaxed.ravel()), dims=relaxed.shape) * ng.CF(place))
    hole = next(name for name in system.conditions if name.startswith("in ") and "cuff" not in name)
    for name, value in (("on the skin", SKIN), ("in cuff 1", IN_CUFF), (hole, INSIDE)):
        value_of(system, name).Set(value)
    probe = Probe(system)
    probe.refresh()
    return probe


def on_skin(domain: Domain, displacement: Field, cuff: Field) -> dict[str, float]:
    places, areas = on(domain, "skin")
    sizes = np.linalg.norm(np.einsum("fpij,fpj->fpi", cofactor(deformation(displacement, places)), areas), axis=-1)
    return {"skin_pressure_Pa": SKIN, "skin_pressure_max_Pa": SKIN + IN_CUFF,
            "skin_pressure_mean_Pa": SKIN + IN_CUFF * np.average(at(cuff, places), weights=sizes)}  # fmt: skip


def at_quadrature_points(domain: Domain, displacement: Field, order: int) -> dict[str, float]:
    found, farthest = {}, 0.0
    for region in domain.regions:
        places = fields.quadrature_points(domain, ng.VOL, region, 2 * order)
        found[f"detF_min_{region}_1"] = np.linalg.det(deformation(displacement, places)).min()
        farthest = max(farthest, np.linalg.norm(at(displacement, places), axis=-1).max())
    return {**found, "displacement_max_m": farthest}


HOLLOW = vessel.GEOMETRY.replace(hollow=True)
HOLE = "series.csv of solids with a hole"


@cache
def hollow() -> Probe:
    cuff = Cuff(pressure=STILL, start=-1.0, end=vessel.L / vessel.LAYERS + vessel.EDGE / 2, edge=vessel.EDGE)
    case = Case(name="hole", geometry=HOLLOW, materials=Materials(tissue=vessel.TISSUE, wall=vessel.WALL),
                loads=Loads(skin_pressure=STILL, outlet_pressure=STILL, cuffs=(cuff,)), time=STATIC,
                conditions=Conditions(initial_state="prestress"), discretisation=Discretisation(order=3))  # fmt: skip
    return state(case, vessel.displacement, vessel.RELAXED)


@source(HOLE)
def _hole() -> Mapping[str, float]:
    return row(hollow())


@entry(HOLE, "skin_pressure_Pa", "skin_pressure_mean_Pa", "skin_pressure_max_Pa")
def _skin_of_the_hole() -> Mapping[str, float]:
    return on_skin(hollow().domain, vessel.displacement, lambda _x, _y, z: 1 - vessel.risen(z))


@entry(HOLE, "displacement_max_m", "detF_min_REGION_1")
def _solids_of_the_hole() -> Mapping[str, float]:
    return at_quadrature_points(hollow().domain, vessel.displacement, 3)


@entry(HOLE, "pressure_HOLE_Pa", "lumen_volume_m3", "lumen_area_mean_m2")
def _in_the_hole() -> Mapping[str, float]:
    places, weights = within(vessel.system().domain, "fluid")  # where the other model has blood
    volume = float(np.linalg.det(deformation(vessel.displacement, places)) @ weights)
    return {"pressure_interface_Pa": INSIDE, "lumen_volume_m3": volume, "lumen_area_mean_m2": volume / vessel.L}


STORES = "series.csv of a vessel with compliances"
KNOWN = {"inlet": (700.0, 45.0), "outlet": (400.0, 21.0)}
"""Opening -> the pressure far behind it, and how much higher that in the compliance is (Pa)."""


@source(STORES)
def stores() -> dict[str, float]:
    openings = {
        name: WindkesselOpening(resistance=1e7, compliance=1e-9, distal_resistance=1e8,
                                distal_pressure=PressureConstant(value=far))
        for name, (far, _) in KNOWN.items()
    }  # fmt: skip
    system = System(case_of(TUBE, **{"loads.openings": openings}), domain_of(TUBE))
    system.update(0.0)
    for name, (_, more) in KNOWN.items():
        system.named(system.state)[f"{name}_stored_pressure"].vec[0] = more
    measured = {name: value for one in system.conditions.values() for name, value in one.columns().items()}
    assert set(measured) <= set(quantities.columns(Probe(system)))
    return {name: value() for name, value in measured.items()}


@entry(STORES, "pressure_stored_OPENING_Pa")
def stored_pressures() -> dict[str, float]:
    return {f"pressure_stored_{name}_Pa": sum(parts) for name, parts in KNOWN.items()}


PLANE = "series.csv of a plane section"
SECTION = subject(1, mesh=SectionSizes(far_size=14e-3, bone_size=9e-3, vein_size=3e-3, curving_order=1))
RELAXED = np.array([[0.04, 0.02], [-0.01, -0.05]])
DIRECTION, HALF_WIDTH, EDGE = 0.8, 1.0, 20e-3


def in_plane(x: Any, y: Any) -> Any:
    return 0.1 * x + 0.2 * y + 2.0 * x * x, 0.05 * x - 0.2 * y - 1.5 * x * y + 1e-3


@cache
def section() -> Probe:
    cuff = Cuff(pressure=STILL, start=-1.0, end=1.0, direction=DIRECTION, half_width=HALF_WIDTH, edge=EDGE)
    laws = {name: vessel.WALL if name == "wall" else vessel.TISSUE for name in SECTION.solids}
    case = Case(name="plane", geometry=SECTION, materials=Materials(**laws), time=STATIC,
                loads=Loads(skin_pressure=STILL, outlet_pressure=STILL, cuffs=(cuff,)),
                conditions=Conditions(initial_state="prestress"), discretisation=Discretisation(order=2))  # fmt: skip
    return state(case, in_plane, RELAXED)


@source(PLANE)
def _plane() -> Mapping[str, float]:
    return row(section())


def cuff_weight(x: Any, y: Any) -> Any:
    """From 1 to 0 within half the edge's width, along the arc, of both ends."""
    away = np.abs(np.angle(np.exp(1j * (np.arctan2(y, x) - DIRECTION))))
    s = np.clip((HALF_WIDTH - away) * np.hypot(x, y) / EDGE + 0.5, 0.0, 1.0)
    return s * s * (3 - 2 * s)


@entry(PLANE, "skin_pressure_Pa", "skin_pressure_mean_Pa", "skin_pressure_max_Pa", rel=1e-3)
def _skin_of_the_section() -> Mapping[str, float]:
    return on_skin(section().domain, in_plane, cuff_weight)


@entry(PLANE, "displacement_max_m", "detF_min_REGION_1")
def _solids_of_the_section() -> Mapping[str, float]:
    return at_quadrature_points(section().domain, in_plane, 2)


@entry(PLANE, "OUTLINE_area_m2")
def _enclosed() -> Mapping[str, float]:
    """Green's theorem around each outline."""
    found = {}
    for name in ("skin", "lumen"):
        places, areas = on(section().domain, name)
        middle = places.mean(axis=(0, 1))
        areas = areas * np.sign(np.sum(areas * (places - middle), axis=-1))[..., None]  # outwards: both are convex
        now = places + at(in_plane, places)
        deformed = np.einsum("fpij,fpj->fpi", cofactor(deformation(in_plane, places)), areas)
        found[f"{name}_area_m2"] = float(np.sum(now * deformed) / 2)
    return found


@entry(PLANE, "REGION_area_m2")
def _regions() -> Mapping[str, float]:
    found = {}
    for name in SECTION.solids:
        places, weights = within(section().domain, name)
        found[f"{name}_area_m2"] = float(np.linalg.det(deformation(in_plane, places)) @ weights)
    return found


@entry(PLANE, "p_tissue_side_Pa", "p_wall_side_Pa", rel=1e-7)
def _beside_the_wall() -> Mapping[str, float]:
    places, areas = on(section().domain, "wall_outer")
    F = deformation(in_plane, places)
    sizes = np.linalg.norm(np.einsum("fpij,fpj->fpi", cofactor(F), areas), axis=-1)
    elastic = np.zeros((*F.shape[:2], 3, 3))
    elastic[..., :2, :2], elastic[..., 2, 2] = F @ np.linalg.inv(np.eye(2) + RELAXED), 1.0
    laws = {"tissue": vessel.TISSUE, "wall": vessel.WALL}
    return {f"p_{name}_side_Pa": np.average(pressure(cauchy(law, elastic)), weights=sizes)
            for name, law in laws.items()}  # fmt: skip


CARRIED = "series.csv of what the blood carries"
_OF_SCALARS = (
    (test_scalars.test_age_of_developed_flow, "age_mean_s", "age_max_s", "age_outlet_s"),
    (test_scalars.test_washout_of_developed_flow, "washout_mean_1", "washout_max_1", "washout_outlet_1",
     "washout_left_1", "washout_time_s"),
    (test_scalars.test_exposure_where_all_deforms_alike, "exposure_mean_1", "exposure_max_1", "exposure_outlet_1"),
    (test_scalars.test_time_near_the_wall, "near_wall_mean_s", "near_wall_max_s", "near_wall_outlet_s"),
)  # fmt: skip


@source(CARRIED)
def _carried() -> Mapping[str, float]:
    scalars = test_scalars.carrying(Age(), Washout(), Exposure(), NearWall())
    scalars.advance(0.0)
    return {column: of() for column, of in scalars.columns().items()}


for _test, *_columns in _OF_SCALARS:
    held_by(_test, CARRIED, *_columns)
