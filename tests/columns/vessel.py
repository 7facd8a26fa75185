"""A vein that is oval, narrows along its way, carries stress without load, is pressed on by cuffs and moves along
itself, with blood that flows out of both its ends: all that is measured of it.

Of flat elements, on which all fields are what they are as polynomials.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from ngfsi.case import Cuff
from ngfsi.config.functions import PressureConstant
from ngfsi.materials import SaintVenantKirchhoff
from ngfsi.measure.probe import Probe
from ngfsi.measure.sections import RING_POINTS
from ngfsi.parallel.stopwatch import Stopwatch
from ngfsi.physics.fields import PRESSURE, VELOCITY
from ngfsi.run.observers import WALL_REFINEMENT, observers_of
from ngfsi.solve.newton import Solution
from ngfsi.solve.time_loop import Step
from ngfsi.store.folder import RunFolder
from ngfsi.store.stored import StoredRun, Which, open_run
from ngfsi.store.table import read_table
from ngfsi.system.system import System
from tests.columns import fields
from tests.columns.fields import at, cauchy, cofactor, deformation, gradient, moved, on, pressure, within
from tests.columns.table import entry, held_by, source
from tests.measure import test_means
from tests.vein import BLOOD, COARSE, BonedTube, case_of, system_of, value_of

Array = NDArray[np.float64]

LAYERS, ORDER, CORNERS = 3, 3, 10
GEOMETRY = BonedTube(mesh=COARSE.replace(curving_order=1, axial_layers=LAYERS))
L, RADIUS = GEOMETRY.length, GEOMETRY.lumen_radius
WALL = SaintVenantKirchhoff(young=133e3, poisson=0.3, density=1060.0)
TISSUE = SaintVenantKirchhoff(young=30e3, poisson=0.2, density=1100.0)
RELAXED = np.array([[0.04, 0.02, 0.01], [-0.01, -0.05, 0.0], [0.0, 0.03, 0.02]])
"""Gradient of the displacement from the shape that carries stress to the one that does not."""
SKIN, CUFF_1, CUFF_2, OUTLET, REFERENCE = 300.0, 900.0, 2000.0, 1250.0, 1300.0
EDGE = L / LAYERS
NEW, AWAY = 2.0, np.array([0.4e-3, -0.7e-3])
WIDE = np.array([[1.05, 0.35], [0.1, 0.7]])
"""How the section at the inlet is deformed; at the outlet it is smaller by the factor 1 - TAPER."""
TAPER, BULGE, FORWARD = 0.35, 12.0, 0.25
RATE = np.array([[-2.0, 1.1], [0.4, -1.2]])
SPEED, LOW = 0.03, 0.12


def displacement(x: Any, y: Any, z: Any) -> Any:
    """Planes across the vein stay such."""
    wide = 1 - TAPER * z / L
    new_x = wide * (WIDE[0, 0] * x + WIDE[0, 1] * y) + BULGE * x * x + AWAY[0]
    new_y = wide * (WIDE[1, 0] * x + WIDE[1, 1] * y) + AWAY[1]
    return new_x - x, new_y - y, FORWARD * z * (L - z) / L


def rate(x: Any, y: Any, z: Any) -> Any:
    """Velocity of solids and mesh: along the vein between its ends, across it the more so the farther along."""
    along = 1 + z / L
    return (along * (RATE[0, 0] * x + RATE[0, 1] * y), along * (RATE[1, 0] * x + RATE[1, 1] * y) + 2e-3,
            SPEED * 4 * z * (L - z) / L**2)  # fmt: skip


def corner(x: Any, y: Any) -> Any:
    """1 on the axis and 0 on the wall, linear in each of the triangles between."""
    angles = np.pi * 2 * (np.arange(CORNERS) + 0.5) / CORNERS + FIRST
    reaches = [(np.cos(a) * x + np.sin(a) * y) / (RADIUS * np.cos(np.pi / CORNERS)) for a in angles]
    number = np.argmax(np.real(np.array(reaches)), axis=0)
    return 1 - np.choose(number, reaches)


FIRST = np.arctan2(-0.8682112809732795, -5.481670290303015)
"""Angle of one of the lumen's corners."""


def profile(x: Any, y: Any, z: Any) -> Any:
    """Velocity of the blood relative to the mesh over that function: back at the inlet, forth at the outlet."""
    return 0.1 + 8 * x, 0.16 * z / L, -0.03 + 0.15 * z / L + 10 * y


def relative(x: Any, y: Any, z: Any) -> Any:
    part = corner(x, y)
    return tuple(part * value for value in profile(x, y, z))


def velocity(x: Any, y: Any, z: Any) -> Any:
    return tuple(w + e for w, e in zip(relative(x, y, z), rate(x, y, z), strict=True))


def blood(x: Any, y: Any, z: Any) -> Any:
    """Pressure of the blood beyond the reference (Pa)."""
    return 200.0 - 9e4 * z + 2e6 * z * z + 3e4 * x - 5e6 * x * y


def risen(z: Any) -> Any:
    """From 0 to 1 over the second third of the length."""
    s = np.clip((z - L / LAYERS) / EDGE, 0.0, 1.0)
    return s * s * (3 - 2 * s)


def cuffs(z: Any) -> Any:
    """Pressure of both cuffs (Pa): each whole over a third of the length and nothing over another."""
    return CUFF_1 * (1 - risen(z)) + CUFF_2 * risen(z)


@cache
def system() -> System:
    still = PressureConstant(value=0.0)
    edges = L / LAYERS + EDGE / 2
    given = (
        Cuff(pressure=still, start=-1.0, end=edges, edge=EDGE),
        Cuff(pressure=still, start=edges, end=1.0, edge=EDGE),
    )
    case = case_of(GEOMETRY, **{
        "materials.wall": WALL, "materials.tissue": TISSUE, "loads.cuffs": given, "discretisation.order": ORDER,
        "conditions.initial_state": "prestress", "output.low_shear": LOW,
    })  # fmt: skip
    found = system_of(case)
    place = (ng.x, ng.y, ng.z)
    motion = ng.CF(displacement(*place))
    found.motion.Set(motion)
    found.new_weight.Set(NEW)
    found.velocity_history.components[0].Set(ng.CF(rate(*place)) - NEW * motion)
    part = ng.GridFunction(ng.H1(found.domain.mesh, order=1))
    axis = [v.nr for v in found.domain.mesh.vertices if np.hypot(*v.point[:2]) < 1e-9]
    part.vec.FV().NumPy()[axis] = 1.0
    state = found.named(found.state)
    state[VELOCITY].Set(part * ng.CF(profile(*place)))
    state[PRESSURE].Set(blood(*place))
    assert found.relaxation is not None
    found.relaxation.Set(ng.CF(tuple(RELAXED.ravel()), dims=(3, 3)) * ng.CF(place))
    for name, value in (("on the skin", SKIN), ("in cuff 1", CUFF_1), ("in cuff 2", CUFF_2), ("outlet", OUTLET)):
        value_of(found, name).Set(value)
    found.reference().Set(REFERENCE)
    return found


@cache
def probe() -> Probe:
    found = Probe(system())
    found.refresh()
    return found


OF = "series.csv of a vein in tissue"


@source(OF)
def _series() -> Mapping[str, Array]:
    return table("series")


@entry(OF, "time_s", "step_s")
def _times() -> Mapping[str, float]:
    return {"time_s": TIME, "step_s": STEP.size}


def over(boundary: str) -> tuple[Array, Array, Array]:
    """Return places (faces, points, 3), deformed areas (faces, points, 3) and deformation of a boundary."""
    places, areas = on(system().domain, boundary)
    F = deformation(displacement, places)
    return places, np.einsum("fpij,fpj->fpi", cofactor(F), areas), F


def mean(values: Array, areas: Array) -> float:
    return float(np.average(values, weights=np.linalg.norm(areas, axis=-1)))


def elastic(places: Array) -> Array:
    """Deformation gradient from the shape without stress."""
    return np.asarray(deformation(displacement, places) @ np.linalg.inv(np.eye(3) + RELAXED))


@entry(OF, "skin_pressure_Pa", "skin_pressure_mean_Pa", "skin_pressure_max_Pa")
def on_the_skin() -> Mapping[str, float]:
    places, areas, _ = over("skin")
    return {"skin_pressure_Pa": SKIN, "skin_pressure_max_Pa": SKIN + CUFF_2,
            "skin_pressure_mean_Pa": mean(SKIN + cuffs(places[..., 2]), areas)}  # fmt: skip


@entry(OF, "displacement_max_m", "detF_min_REGION_1")
def _at_quadrature_points() -> Mapping[str, float]:
    found, farthest = {}, 0.0
    for region in ("tissue", "wall", "fluid"):
        places = fields.quadrature_points(system().domain, ng.VOL, region, 2 * ORDER)
        found[f"detF_min_{region}_1"] = np.linalg.det(deformation(displacement, places)).min()
        if region != "fluid":
            farthest = max(farthest, np.linalg.norm(at(displacement, places), axis=-1).max())
    return {**found, "displacement_max_m": farthest}


@entry(OF, "outlet_pressure_Pa")
def _outlet() -> Mapping[str, float]:
    return {"outlet_pressure_Pa": OUTLET}


@entry(OF, "lumen_volume_m3", "lumen_area_mean_m2", "lumen_volume_rate_m3_s", "flow_in_m3_s", "flow_out_m3_s",
       "mass_defect_m3_s")  # fmt: skip
def _volume_and_flow() -> Mapping[str, float]:
    places, weights = within(system().domain, "fluid")
    F = deformation(displacement, places)
    volume = float(np.linalg.det(F) @ weights)
    change = float(np.einsum("pij,pij->p", cofactor(F), gradient(rate, places)) @ weights)
    inwards, outwards = (flow_through(name) for name in ("inlet", "outlet"))
    return {
        "lumen_volume_m3": volume,
        "lumen_area_mean_m2": volume / L,
        "lumen_volume_rate_m3_s": change,
        "flow_in_m3_s": inwards,
        "flow_out_m3_s": outwards,
        "mass_defect_m3_s": change + outwards - inwards,
    }


def flow_through(opening: str) -> float:
    """Return the flow through an opening, relative to it, along the vein (m3/s)."""
    places, areas, _ = over(opening)
    areas = areas * np.sign(areas[..., 2:])
    # on the edges of the lumen's triangles the profile is that of both
    return float(np.sum(at(relative, places) * areas))


@entry(OF, "pressure_OPENING_Pa")
def _openings() -> Mapping[str, float]:
    found = {}
    for name in ("inlet", "outlet"):
        places, areas, _ = over(name)
        found[f"pressure_{name}_Pa"] = REFERENCE + mean(at(blood, places), areas)
    return found


@entry(OF, "p_tissue_side_Pa", "p_wall_side_Pa", "p_wall_mean_Pa", rel=1e-7)
def _solids() -> Mapping[str, float]:
    places, areas, _ = over("wall_outer")
    inside, weights = within(system().domain, "wall")
    sizes = weights * np.linalg.det(deformation(displacement, inside))
    return {
        "p_tissue_side_Pa": mean(pressure(cauchy(TISSUE, elastic(places))), areas),
        "p_wall_side_Pa": mean(pressure(cauchy(WALL, elastic(places))), areas),
        "p_wall_mean_Pa": float(np.average(pressure(cauchy(WALL, elastic(inside))), weights=sizes)),
    }


STATIONS = np.linspace(0, L, 11)


def before(height: Array) -> Array:
    """Return the reference heights of planes at heights in space."""
    b = 1 + FORWARD
    return np.asarray((b - np.sqrt(b * b - 4 * FORWARD * height / L)) * L / (2 * FORWARD))


def outline(z: float) -> tuple[Array, Array]:
    """Return places (edges, points, 3) on the reference outline at a reference height and steps (edges, points, 3)."""
    angles = FIRST + 2 * np.pi * np.arange(CORNERS) / CORNERS
    corners = RADIUS * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ways = np.roll(corners, -1, axis=0) - corners
    flat = corners[:, None] + fields.NODES[:, None] * ways[:, None]
    places = np.concatenate([flat, np.full((*flat.shape[:2], 1), z)], axis=2)
    steps = fields.WEIGHTS[:, None] * np.pad(ways, ((0, 0), (0, 1)))[:, None]
    return places, steps


def section(height: float) -> dict[str, float]:
    """Return area, perimeter, area rate in the fixed plane, and integrals over the section at a height in space."""
    z = float(before(np.array(height)))
    places, steps = outline(z)
    F = deformation(displacement, places)
    now, along = moved(displacement, places), np.einsum("epij,epj->epi", F, steps)
    x, y = now[..., 0] - AWAY[0], now[..., 1] - AWAY[1]
    area = float(np.sum(x * along[..., 1] - y * along[..., 0]) / 2)
    # a plane that stays where it is goes backwards through the material
    backwards = at(rate, places)[..., 2] / F[..., 2, 2]
    drift = at(rate, places) - backwards[..., None] * F[..., :, 2]
    swept = float(np.sum(drift[..., 0] * along[..., 1] - drift[..., 1] * along[..., 0]))
    return {"area": area, "perimeter": float(np.linalg.norm(along, axis=-1).sum()), "rate": swept}


@cache
def sections() -> dict[str, Array]:
    found = [section(float(height)) for height in STATIONS]
    return {name: np.array([one[name] for one in found]) for name in found[0]}


def along(name: str, unit: str, values: Array) -> dict[str, float]:
    return {f"{name}_z{number:02d}_{unit}": float(value) for number, value in enumerate(values)}


@entry(OF, "area_z#_m2")
def _areas() -> Mapping[str, float]:
    return along("area", "m2", sections()["area"])


@entry(OF, "p_blood_z#_Pa")
def _on_the_axis() -> Mapping[str, float]:
    places = np.stack([0 * STATIONS, 0 * STATIONS, STATIONS], axis=1)
    return along("p_blood", "Pa", REFERENCE + at(blood, places))


@entry(OF, "p_transmural_z#_Pa", rel=1e-4)
def _transmural() -> Mapping[str, float]:
    """Of the tissue the mean around each level of the mesh with the hat functions there."""
    places, areas, _ = over("wall_outer")
    sizes, levels = np.linalg.norm(areas, axis=-1), np.linspace(0, L, LAYERS + 1)
    normals = areas / sizes[..., None]
    outside = -np.einsum("fpi,fpij,fpj->fp", normals, cauchy(TISSUE, elastic(places)), normals)
    hats = [np.maximum(1 - np.abs(places[..., 2] - level) / EDGE, 0.0) * sizes for level in levels]
    tissue = [np.average(outside, weights=hat) for hat in hats]
    inside = np.array(list(_on_the_axis().values()))
    return along("p_transmural", "Pa", inside - np.interp(STATIONS, levels, tissue))


def shear(places: Array, areas: Array) -> Array:
    """Return the wall shear stress (..., 3) [Pa] at places with deformed areas of either direction."""
    normals = areas / np.linalg.norm(areas, axis=-1)[..., None]
    normals = normals * np.sign(np.sum(normals[..., :2] * places[..., :2], axis=-1))[..., None]  # out of the blood
    L_ = gradient(velocity, places) @ np.linalg.inv(deformation(displacement, places))
    traction = np.einsum("...ij,...j->...i", -BLOOD.viscosity * (L_ + np.swapaxes(L_, -1, -2)), normals)
    return np.asarray(traction - np.sum(traction * normals, axis=-1)[..., None] * normals)


@entry(OF, "sawss_Pa", rel=1e-4)
def _mean_shear() -> Mapping[str, float]:
    places, areas, _ = over("interface")
    return {"sawss_Pa": mean(np.linalg.norm(shear(places, areas), axis=-1), areas)}


@entry(OF, "wss_low_area_1", rel=5e-2)
def _low_shear() -> Mapping[str, float]:
    places, areas, _ = over("interface")
    return {"wss_low_area_1": mean(np.linalg.norm(shear(places, areas), axis=-1) < LOW, areas)}


@entry(OF, "wss_min_Pa", "wss_max_Pa")
def _extreme_shear() -> Mapping[str, float]:
    places, _, _ = over("interface")
    points = fields.quadrature_points(system().domain, ng.BND, "interface", 2 * ORDER).reshape(len(places), -1, 3)
    normals = np.broadcast_to(on(system().domain, "interface")[1][:, :1], points.shape)
    deformed = np.einsum("fpij,fpj->fpi", cofactor(deformation(displacement, points)), normals)
    sizes = np.linalg.norm(shear(points, deformed), axis=-1)
    return {"wss_min_Pa": sizes.min(), "wss_max_Pa": sizes.max()}


@entry(OF, "wss_z#_Pa", rel=4e-3)
def _shear_around_stations() -> Mapping[str, float]:
    found = []
    for height in STATIONS:
        places, steps = outline(float(before(height)))
        F = deformation(displacement, places)
        normals = np.cross(steps, [0.0, 0.0, 1.0])
        deformed = np.einsum("epij,epj->epi", cofactor(F), normals)
        sizes = np.linalg.norm(shear(places, deformed), axis=-1)
        found.append(np.average(sizes, weights=np.linalg.norm(np.einsum("epij,epj->epi", F, steps), axis=-1)))
    return along("wss", "Pa", np.array(found))


def moments(z: float) -> dict[str, Any]:
    """Return centroid (2,), squared semi-axes and angle of the ellipse with the second moments of a section at a
    reference height."""
    angles = FIRST + 2 * np.pi * np.arange(CORNERS + 1) / CORNERS
    corners = RADIUS * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    shares, parts = fields.triangle()
    flat = np.concatenate([shares @ np.stack([np.zeros(2), *corners[k : k + 2]]) for k in range(CORNERS)])
    places = np.pad(flat, ((0, 0), (0, 1)), constant_values=z)
    weights = np.tile(parts, CORNERS) * np.linalg.det(deformation(displacement, places)[:, :2, :2])
    now = moved(displacement, places)[:, :2]
    centre = np.average(now, weights=weights, axis=0)
    spread = np.cov(now.T, aweights=weights, bias=True)
    (small, large), axes = np.linalg.eigh(spread)
    return {"centre": centre, "ratio": np.sqrt(large / small), "angle": np.arctan(axes[1, 1] / axes[0, 1])}


@cache
def fine() -> dict[str, Array]:
    """Return sections at even heights with the flow through them, by Simpson's rule."""
    from scipy.integrate import cumulative_simpson

    heights = np.linspace(0, L, 101)
    found = [section(float(height)) | moments(float(before(height))) for height in heights]
    parts = {name: np.array([one[name] for one in found]) for name in found[0]}
    swept = cumulative_simpson(parts["rate"], x=heights, initial=0.0)
    return {**parts, "height": heights, "flow": flow_through("inlet") - swept}


@entry(OF, "sawss_poiseuille_inlet_Pa", "sawss_poiseuille_local_Pa", "sawss_ellipse_local_Pa", rel=4e-3)
def _developed() -> Mapping[str, float]:
    s = fine()
    radius = np.sqrt(s["area"] / np.pi)
    stresses = {
        "sawss_poiseuille_inlet_Pa": 4 * BLOOD.viscosity * abs(s["flow"][0]) / (np.pi * radius**3),
        "sawss_poiseuille_local_Pa": 4 * BLOOD.viscosity * np.abs(s["flow"]) / (np.pi * radius**3),
    }
    a, b = radius * np.sqrt(s["ratio"]), radius / np.sqrt(s["ratio"])
    slope = 4 * BLOOD.viscosity * np.abs(s["flow"]) * (a**2 + b**2) / (np.pi * a**3 * b**3)
    stresses["sawss_ellipse_local_Pa"] = slope * s["area"] / s["perimeter"]
    return {name: np.average(values, weights=s["perimeter"]) for name, values in stresses.items()}


@entry(OF, "reynolds_1", rel=1e-4)
def _reynolds() -> Mapping[str, float]:
    s = fine()
    speed, diameter = np.abs(s["flow"]) / s["area"], np.sqrt(4 * s["area"] / np.pi)
    return {"reynolds_1": BLOOD.density / BLOOD.viscosity * np.max((speed * diameter)[::10])}


TIME = 0.7
STEP = Step(index=3, time=TIME, size=0.9, seconds=1.5,
            solution=Solution(iterations=7, factorisations=2, linear_iterations=11))  # fmt: skip


@cache
def stored() -> tuple[StoredRun, TemporaryDirectory[str]]:
    """Return the folder into which the state is written as a run does after a step."""
    place = TemporaryDirectory()
    path, state = Path(place.name) / "run", system()
    folder = RunFolder.create(path, state.case)
    for observer in observers_of(state.case, state, probe(), folder, Stopwatch(), -np.inf):
        observer.look(TIME, STEP)
    return open_run(path), place


def table(name: str) -> Mapping[str, Array]:
    return read_table(stored()[0].path / f"{name}.csv")


@source("costs.csv")
def _costs() -> Mapping[str, Array]:
    return table("costs")


@entry("costs.csv", "time_s", "step", "wall_s", "iterations", "factorisations", "linear_iterations")
def _of_the_step() -> Mapping[str, float]:
    return {"time_s": 0.7, "step": 3, "wall_s": 1.5, "iterations": 7, "factorisations": 2, "linear_iterations": 11}


@source("shape.csv")
def _shape() -> Mapping[str, Array]:
    return table("shape")


@entry("shape.csv", "time_s", "station")
def _rows() -> Mapping[str, Array]:
    return {"time_s": np.full(11, TIME), "station": np.arange(11.0)}


@entry("shape.csv", "centre_x_m", "centre_y_m", "centre_z_m", "area_m2", "perimeter_m", "hydraulic_diameter_m",
       "circularity_1", "major_semiaxis_m", "minor_semiaxis_m", "major_angle_rad", rel=1e-6)  # fmt: skip
def _shapes() -> Mapping[str, Array]:
    s = {name: values[::10] for name, values in fine().items()}
    round_radius = np.sqrt(s["area"] / np.pi)
    return {
        "centre_x_m": s["centre"][:, 0], "centre_y_m": s["centre"][:, 1], "centre_z_m": STATIONS,
        "area_m2": s["area"], "perimeter_m": s["perimeter"], "hydraulic_diameter_m": 4 * s["area"] / s["perimeter"],
        "circularity_1": 4 * np.pi * s["area"] / s["perimeter"] ** 2,
        "major_semiaxis_m": round_radius * np.sqrt(s["ratio"]), "minor_semiaxis_m": round_radius / np.sqrt(s["ratio"]),
        "major_angle_rad": s["angle"],
    }  # fmt: skip


def back(places: Array) -> Array:
    """Return the reference places (points, 3) of places in space, by Newton's method."""
    found = np.column_stack([(places[:, :2] - AWAY) @ np.linalg.inv(WIDE).T, before(places[:, 2])])
    for _ in range(20):
        rest = places - moved(displacement, found)
        found = found + np.linalg.solve(deformation(displacement, found), rest[:, :, None])[:, :, 0]
    return np.asarray(found)


@source("outlines.csv")
def _outlines() -> Mapping[str, Array]:
    return table("outlines")


@entry("outlines.csv", "time_s", "station", "point", "x_m", "y_m", "z_m")
def _rings() -> Mapping[str, Array]:
    """Points of the exact outlines on the same rays from the axis of the reference shape."""
    height = np.repeat(STATIONS, RING_POINTS)
    flat = back(np.stack([table("outlines")[f"{axis}_m"] for axis in "xyz"], axis=1))[:, :2]
    flat /= 1 - corner(*flat.T)[:, None]
    x, y, _ = moved(displacement, np.column_stack([flat, before(height)])).T
    return {"time_s": np.full(len(height), TIME), "station": np.repeat(np.arange(11.0), RING_POINTS),
            "point": np.tile(np.arange(float(RING_POINTS)), 11), "x_m": x, "y_m": y, "z_m": height}  # fmt: skip


@source("volume.vtu")
def _volume() -> Mapping[str, Array]:
    return fields_of("volume")


@source("wall.vtu")
def _wall() -> Mapping[str, Array]:
    return fields_of("wall")


def fields_of(which: Which) -> dict[str, Array]:
    grid = stored()[0].fields(TIME, which)
    return {
        name: np.asarray(values, dtype=float) for name, values in (*grid.point_data.items(), *grid.cell_data.items())
    }


@cache
def volume_places() -> tuple[Array, Array]:
    """Return the reference places (points, 3) of the stored points, and the number of the region (points,) of each."""
    grid = stored()[0].fields(TIME)
    regions = np.zeros(grid.n_points, dtype=int)
    regions[grid.cell_connectivity] = np.repeat(grid.cell_data["region"], np.diff(grid.cell_offsets))
    return back(np.asarray(grid.points, dtype=float)), regions


@entry("volume.vtu", "displacement_m", "velocity_m_s", "pressure_Pa", "region", rel=2e-6)
def _fields() -> Mapping[str, Array]:
    places, regions = volume_places()
    in_blood = regions == 2
    flowing = np.where(in_blood[:, None], at(relative, places), 0.0)
    counts = [len(list(system().domain.mesh.Materials(name).Elements())) for name in ("tissue", "wall", "fluid")]
    return {"displacement_m": at(displacement, places), "velocity_m_s": at(rate, places) + flowing,
            "pressure_Pa": np.where(in_blood, REFERENCE + at(blood, places), 0.0),
            "region": np.repeat(np.arange(3.0), counts)}  # fmt: skip


@entry("volume.vtu", "hydrostatic_pressure_Pa", "principal_stresses_Pa", "principal_stretches_1", rel=5e-3)
def _tensors() -> Mapping[str, Array]:
    """They are stored as polynomials on each element."""
    places, regions = volume_places()
    F = np.where((regions < 2)[:, None, None], elastic(places), 0.0)
    stress = np.zeros_like(F)
    for number, law in enumerate((TISSUE, WALL)):
        stress[regions == number] = cauchy(law, F[regions == number])
    return {
        "hydrostatic_pressure_Pa": pressure(stress),
        "principal_stresses_Pa": np.linalg.eigvalsh(stress)[:, ::-1],
        "principal_stretches_1": np.sqrt(np.abs(np.linalg.eigvalsh(np.swapaxes(F, 1, 2) @ F)[:, ::-1])),
    }


@entry("wall.vtu", "wall_shear_Pa", "wall_shear_axial_Pa", "wall_shear_circumferential_Pa",
       "wall_shear_magnitude_Pa", "pressure_Pa", rel=1e-5)  # fmt: skip
def _wall_fields() -> Mapping[str, Array]:
    """Along the material line that was parallel to the axis, and around it."""
    grid = stored()[0].fields(TIME, "wall")
    faces = back(np.asarray(grid.points, dtype=float)).reshape(-1, (WALL_REFINEMENT + 1) ** 2, 3)
    middles = faces.mean(axis=1, keepdims=True)
    places = faces + 1e-6 * (middles - faces)  # in one triangle of the blood each
    F, normals = deformation(displacement, places), middles * [1.0, 1.0, 0.0] + 0 * places
    areas = np.einsum("fpij,fpj->fpi", cofactor(F), normals)
    tau, n = shear(places, areas), areas / np.linalg.norm(areas, axis=-1)[..., None]
    way = F[..., :, 2] - np.sum(F[..., :, 2] * n, axis=-1)[..., None] * n
    way /= np.linalg.norm(way, axis=-1)[..., None]
    around = np.cross(way, n)
    pick = {"wall_shear_axial_Pa": way, "wall_shear_circumferential_Pa": around}
    return {
        "wall_shear_Pa": tau.reshape(-1, 3), "wall_shear_magnitude_Pa": np.linalg.norm(tau, axis=-1).ravel(),
        "pressure_Pa": REFERENCE + at(blood, faces).ravel(),
        **{name: np.sum(tau * axis, axis=-1).ravel() for name, axis in pick.items()},
    }  # fmt: skip


held_by(test_means.test_wall_shear_by_the_balance_of_momentum, OF, "sawss_consistent_Pa")
