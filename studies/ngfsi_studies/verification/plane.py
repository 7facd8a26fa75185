"""Cases given by geometry, flow and materials, their refinement and their march in time: of no benchmark by itself."""

from __future__ import annotations

from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from time import monotonic
from typing import Any

import ngfsi_geometry
import numpy as np
from ngfsi_geometry.channel import PlaneSection
from numpy.typing import NDArray

import ngfsi
import ngfsi_studies
from ngfsi.case import Case, Conditions, Discretisation, Loads, Materials, Solver, TimeStepping
from ngfsi.conditions import Condition
from ngfsi.config.functions import FlowConstant, PressureConstant
from ngfsi.measure.deformation import Deformation
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.generate import cache_folder
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.store.checkpoint import Checkpoints
from ngfsi.system.system import System

Array = NDArray[np.float64]

SAVED_EVERY = 60.0
"""Seconds between two copies of an unfinished computation."""


def case_of(geometry: Any, flow: float, materials: Materials, **more: Any) -> Case:
    """Return the case of a constant flow (m3/s; per metre of depth in the plane), with the order of the curving.

    Args:
        more: changes of the case.
    """
    return Case(
        name="verification",
        geometry=geometry,
        materials=materials,
        loads=Loads(
            skin_pressure=PressureConstant(value=0.0),
            inlet_flow=FlowConstant(value=flow),
            outlet_pressure=PressureConstant(value=0.0),
        ),
        conditions=Conditions(ends="clamped"),
        discretisation=Discretisation(order=geometry.curving_order),
        time=TimeStepping(step=1.0, end=1.0),
        solver=Solver(tolerance=1e-9),
    ).replace(**more)


def refined(geometry: PlaneSection, order: int, h: float) -> PlaneSection:
    """Return a geometry whose mesh has the polynomial order and h times the element sizes that it was given."""
    sizes = [name for name in type(geometry.mesh).model_fields if name.endswith("_size")]
    changes: dict[str, Any] = {f"mesh.{name}": h * getattr(geometry.mesh, name) for name in sizes}
    return geometry.replace(**changes, **{"mesh.curving_order": order})


def march(system: System, newton: Newton, measure: Callable[[], Array]) -> Array:
    """Run a case in time and return rows of time (s) and measures, the start included.

    What was computed is kept beside the cached meshes; a computation that was stopped goes on from there.
    """
    store = Checkpoints(cache_folder().parent / "verification" / _fingerprint(system), {})
    rows = [np.concatenate([[0.0], measure()])]
    loop = TimeLoop(system.case, system, newton, Deformation(system).inversion)
    if kept := store.latest():
        rows = list(kept.arrays.pop("rows"))
        loop.restore(kept.arrays)
    saved = monotonic()
    for step in loop.run():
        rows.append(np.concatenate([[step.time], measure()]))
        if monotonic() - saved > SAVED_EVERY:
            store.write(step.index, loop.arrays() | {"rows": np.array(rows)})
            saved = monotonic()
    store.clear()
    return np.array(rows)


def _fingerprint(system: System) -> str:
    """Return a name for a computation: another case, other conditions or another program has another one."""
    found = sha256(f"{list(system.conditions)} {system.case!r}".encode())
    for package in (ngfsi, ngfsi_geometry, ngfsi_studies):
        for path in sorted(Path(package.__path__[0]).rglob("*.py")):
            found.update(path.read_bytes())
    return found.hexdigest()[:32]


def at_rest(case: Case, *more: Condition) -> tuple[System, Domain]:
    """Return the system of a case, under further conditions, with all rates zero and what acts at t = 0."""
    domain = Domain.build(case.geometry)
    system = System(case, domain, more=more)
    system.set_steady()
    system.update(0.0)
    return system, domain
