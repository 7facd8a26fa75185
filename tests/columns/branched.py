"""A branched vessel that widens along both its branches: what is measured along each, away from the fork and the ends,
and at its openings; and what tells branches and vessels apart in files."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import ngsolve as ng
import numpy as np
from ngfsi_geometry.calf import CalfSegment, CalfVein
from numpy.typing import NDArray

from ngfsi.case import Materials
from ngfsi.conditions import FlowOpening, PressureOpening
from ngfsi.config.functions import FlowConstant
from ngfsi.materials import load_set
from ngfsi.measure.probe import Probe
from ngfsi.parallel.stopwatch import Stopwatch
from ngfsi.physics.fields import PRESSURE, VELOCITY
from ngfsi.run.observers import observers_of
from ngfsi.store.folder import RunFolder
from ngfsi.store.stored import StoredRun, open_run
from ngfsi.system.system import System
from tests.columns import fields
from tests.columns.fields import at, cofactor, deformation, gradient, moved
from tests.columns.table import entry, held_by, kind_of, source
from tests.measure import test_branches
from tests.measure.test_branches import RADIUS, REST, SMALL, Tee, case_of
from tests.runs import row
from tests.seams.test_second_vein import FIRST, MESH, SECOND
from tests.vein import BLOOD, domain_of

Array = NDArray[np.float64]

OF = "series.csv of a branched vessel"
REFERENCE = 1300.0
RELATIVE = np.array([-0.04, 0.01, 0.09])
"""Velocity of the blood relative to the mesh, on the axes: in the second of both states."""
SLOPES = np.array([[8.0, 1.0, 2.0], [0.0, -13.0, 1.0], [4.0, -1.0, 5.0]])
MIDDLE = np.array([0.04, 0.0, 0.03])
TRUNK, BRANCH = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
PLACES = {  # of stations away from the fork, by column: line, place along it in space, axis there, radius
    # the line into the branch goes round the corner, in 31.67 mm in place of 32
    ("", 1): (-12.6e-3, TRUNK, RADIUS), ("", 2): (-9.2e-3, TRUNK, RADIUS),
    ("", 8): (11.2e-3, TRUNK, RADIUS), ("", 9): (14.6e-3, TRUNK, RADIUS),
    ("outlet_2", 8): (9.667e-3, BRANCH, SMALL * RADIUS),
    ("outlet_2", 9): (12.833e-3, BRANCH, SMALL * RADIUS),
}  # fmt: skip


def displacement(x: Any, y: Any, z: Any) -> Any:
    """Planes across both branches stay such, and nearly where they are: flow is that through layers of the blood."""
    return 5.0 * x * (x - 11.2e-3), 16.0 * y * z + 24.0 * x * y, 0.0 * z


def velocity(x: Any, y: Any, z: Any) -> Any:
    """Without divergence, which the levels of a layer need to carry the same flow, and along branches nearly linear."""
    place = [start + d for start, d in zip((x, y, z), displacement(x, y, z), strict=True)]
    u, v, w = (sum(slope * part for slope, part in zip(row, place, strict=True)) for row in SLOPES)
    return u + 280.0 * z * z + MIDDLE[0], v + 400.0 * x * x, w + MIDDLE[2]


def blood(x: Any, y: Any, z: Any) -> Any:
    return 100.0 + 2e4 * z + 3e4 * x - 1e4 * y


@cache
def probe() -> Probe:
    system = System(case_of(Tee(), outlet_2=PressureOpening(pressure=REST)), domain_of(Tee()))
    place = (ng.x, ng.y, ng.z)
    system.motion.Set(ng.CF(displacement(*place)))
    state = system.named(system.state)
    system.velocity_history.components[0].Set(ng.CF(velocity(*place)))
    state[PRESSURE].Set(blood(*place))
    system.reference().Set(REFERENCE)
    return Probe(system)


@cache
def rows() -> tuple[dict[str, float], dict[str, float]]:
    """Return what is measured where the blood goes with the mesh, and where it also flows through the openings."""
    found = []
    velocity = probe().system.named(probe().system.state)[VELOCITY]
    straight, aside = (1 - (one**2 + other**2) / radius**2
                       for one, other, radius in ((ng.x, ng.y, RADIUS), (ng.y, ng.z, SMALL * RADIUS)))  # fmt: skip
    for size in (0.0, 1.0):
        velocity.Set(size * ng.IfPos(ng.x - 1.5 * RADIUS, aside, straight) * ng.CF(tuple(RELATIVE)))
        probe().refresh()
        found.append(row(probe()))
    return found[0], found[1]


def column(name: str, unit: str, branch: str, station: int) -> str:
    return "_".join(filter(None, (name, branch, f"z{station:02d}", unit)))


@source(OF)
def _row() -> Mapping[str, float]:
    """Along the branches, and what other vessels have not."""
    along, through = rows()
    stations = {column(name, unit, *key) for name, unit in ALONG for key in PLACES}
    kinds = {name: kind_of(name) for name in along}
    return {
        **{
            name: value for name, value in along.items() if name in stations or kinds[name] in ("reynolds_1", PRESSURES)
        },
        **{name: value for name, value in through.items() if kinds[name] == FLOWS},
    }


PRESSURES, FLOWS = "pressure_OPENING_Pa", "flow_OPENING_m3_s"
ALONG = (("area", "m2"), ("wss", "Pa"), ("flow", "m3_s"), ("p_blood", "Pa"))


def outline(height: float, axis: Array, radius: float) -> tuple[Array, Array]:
    """Return reference places (points, 3) and radial directions (points, 3) of what is in a plane across the axis."""
    others = np.array([np.roll(axis, 1), np.roll(axis, 2)])
    angles = 2 * np.pi * np.arange(400) / 400
    radial = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ others
    places = radius * radial + height * axis
    for _ in range(30):
        rest = height - moved(displacement, places) @ axis
        places = places + (rest / (deformation(displacement, places) @ axis @ axis))[:, None] * axis
    return places, radial


@cache
def section(height: float, axis: tuple[float, ...], radius: float) -> tuple[float, Array, float]:
    """Return area (m2) and centroid (3,) [m] of a section, and the mean wall shear stress (Pa) around it."""
    places, radial = outline(height, np.array(axis), radius)
    now, F = moved(displacement, places), deformation(displacement, places)
    first, second = np.roll(axis, 1), np.roll(axis, 2)
    x, y = now @ first, now @ second
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    area = cross.sum() / 2
    middle = [np.sum((part + np.roll(part, -1)) * cross) / (6 * area) for part in (x, y)]
    n = np.einsum("pij,pj->pi", cofactor(F), radial)
    n /= np.linalg.norm(n, axis=1)[:, None]
    rates = gradient(velocity, places) @ np.linalg.inv(F)
    traction = BLOOD.viscosity * np.einsum("pij,pj->pi", rates + np.swapaxes(rates, 1, 2), n)
    sizes = np.linalg.norm(traction - np.sum(traction * n, axis=1)[:, None] * n, axis=1)
    steps = np.linalg.norm(np.roll(now, -1, axis=0) - np.roll(now, 1, axis=0), axis=1)
    return (
        abs(float(area)),
        middle[0] * first + middle[1] * second + height * np.array(axis),
        float(np.average(sizes, weights=steps)),
    )


@entry(OF, "area_z#_m2", "wss_z#_Pa", rel=2e-3)
@entry(OF, "flow_z#_m3_s", rel=1e-2)
def _sections() -> Mapping[str, float]:
    found = {}
    for key, (height, axis, radius) in PLACES.items():
        area, middle, shear = section(height, tuple(axis), radius)
        found[column("area", "m2", *key)] = area
        found[column("wss", "Pa", *key)] = shear
        # of a linear velocity, that at the middle
        found[column("flow", "m3_s", *key)] = float((SLOPES @ middle + MIDDLE) @ axis) * area
    return found


@entry(OF, "p_blood_z#_Pa", rel=1e-3)
def _on_the_lines() -> Mapping[str, float]:
    return {column("p_blood", "Pa", *key): REFERENCE + float(blood(*(height * axis)))
            for key, (height, axis, _) in PLACES.items()}  # fmt: skip


@entry(OF, PRESSURES, FLOWS, rel=4e-3)
def _openings() -> Mapping[str, float]:
    """Flow is relative to the opening, and counts along the vessel."""
    found = {}
    shares, parts = fields.triangle()
    angles = 2 * np.pi * np.arange(65) / 64
    for name, (middle, axis, radius) in {
        "inlet": (-16e-3 * TRUNK, TRUNK, RADIUS), "outlet": (18e-3 * TRUNK, TRUNK, RADIUS),
        "outlet_2": (16e-3 * BRANCH, BRANCH, SMALL * RADIUS),
    }.items():  # fmt: skip
        rim = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ np.array([np.roll(axis, 1), np.roll(axis, 2)])
        corners = [np.stack([0 * axis, a, b]) for a, b in pairwise(rim)]
        places = middle + radius * np.concatenate([shares @ corner for corner in corners])
        weights = np.tile(parts, len(corners)) * np.pi * radius**2 / len(corners)
        areas = cofactor(deformation(displacement, places)) @ axis * weights[:, None]
        found[f"flow_{name}_m3_s"] = float((1 - np.sum((places - middle) ** 2, axis=1) / radius**2) @ areas @ RELATIVE)
        sizes = np.linalg.norm(areas, axis=1)
        found[f"pressure_{name}_Pa"] = REFERENCE + float(np.average(at(blood, places), weights=sizes))
    return found


held_by(test_branches.test_flow_of_a_given_velocity, OF, "reynolds_1")


FILES = "outlines.csv, shape.csv and wall.vtu of several centrelines"


@source(FILES)
def _numbered() -> Mapping[str, Array]:
    """Middles of sections and walls as they are found under each number: of both branches along the trunk, of two veins
    across it."""
    along, (tee, _) = [], written(probe())
    for view in (tee, tee.of_branch("outlet_2")):
        along.append([view.shape["centre_z_m"][9], view.outlines(0.0)[1][9, :, 2].mean()])
    across, (calf, _) = [], written(two_veins())
    for view in (calf.of_vessel(""), calf.of_vessel("vein_2")):
        ring, wall = view.outlines(0.0)[1][5], view.fields(0.0, "wall")
        across.append([view.shape["centre_x_m"][5], ring[:, 0].mean(), wall.center[0]])
    return {"branch": np.array(along), "vessel": np.array(across)}


@entry(FILES, "branch", "vessel", rel=1e-3)
def _middles() -> Mapping[str, Array]:
    aside = section(*PLACES["outlet_2", 9][:1], tuple(BRANCH), SMALL * RADIUS)[1][2]
    return {"branch": np.array([[14.6e-3] * 2, [aside] * 2]),
            "vessel": np.array([[FIRST["vein_x"]] * 3, [SECOND["vein_x"]] * 3])}  # fmt: skip


def written(probe: Probe) -> tuple[StoredRun, TemporaryDirectory[str]]:
    """Return the folder into which the state of a probe is written as a run does."""
    place, system = TemporaryDirectory(), probe.system
    folder = RunFolder.create(Path(place.name) / "run", system.case)
    folder.update_manifest(vessels={name: vessel.summary() for name, vessel in probe.vessels.items()})
    probe.refresh()
    for observer in observers_of(system.case, system, probe, folder, Stopwatch(), -np.inf):
        observer.look(0.0, None)
    return open_run(folder.path), place


def two_veins() -> Probe:
    openings = {"inlet_2": FlowOpening(flow=FlowConstant(value=0.0)), "outlet_2": PressureOpening(pressure=REST)}
    beside = CalfVein(lumen_diameter=SECOND["lumen_diameter"], x=SECOND["vein_x"], y=SECOND["vein_y"])
    geometry = CalfSegment(length=40e-3, mesh=MESH.replace(curving_order=1), further_veins=(beside,), **FIRST)
    laws = Materials(tissue=load_set("mooney_rivlin_s1"), wall=load_set("vein_wall_source"), fluid=BLOOD)
    case = case_of(Tee(), **openings).replace(geometry=geometry, materials=laws)
    return Probe(System(case, domain_of(geometry)))
