"""Plane flow around a cylinder, and a beam behind it, solved with the coupled system: of no benchmark by itself."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic
from typing import Any

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from geometry.channel import PlaneSection
from ngfsi.case import Case, Conditions, Discretisation, Loads, Materials, Solver, TimeStepping
from ngfsi.curves import FlowConstant, PressureConstant
from ngfsi.domain import Domain
from ngfsi.materials import Newtonian, SolidLaw
from ngfsi.meshing import cache_folder
from ngfsi.solve.newton import Newton
from ngfsi.solve.system import System
from ngfsi.solve.timeloop import History, TimeLoop

Array = NDArray[np.float64]

SAVED_EVERY = 60.0
"""Seconds between two copies of an unfinished computation."""


def case_of(geometry: PlaneSection, flow: float, fluid: Newtonian | None, solid: SolidLaw | None, **more: Any) -> Case:
    """Return the case of a steady flow (m3/s per metre of depth), with the order of the geometry's curving.

    Args:
        more: changes of the case.
    """
    return Case(
        name="verification",
        geometry=geometry,
        materials=Materials(solid=solid, fluid=fluid),
        loads=Loads(
            skin_pressure=PressureConstant(value=0.0),
            inlet_flow=FlowConstant(value=flow),
            outlet_pressure=PressureConstant(value=0.0),
        ),
        conditions=Conditions(ends="clamped"),
        discretisation=Discretisation(order=geometry.curving_order, mesh_motion="elastic"),
        time=TimeStepping(step=1.0, end=1.0),
        solver=Solver(compile=False, tolerance=1e-9),
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
    store = cache_folder().parent / "verification" / f"{system.case.digest[:32]}.npz"
    rows: list[Array] = []
    history = None
    if store.exists():
        with np.load(store, allow_pickle=False) as kept:
            rows, history = list(kept["rows"]), History.of(kept)
    else:
        rows.append(np.concatenate([[0.0], measure()]))
    loop = TimeLoop(system.case, system, newton, lambda: inversion(system), _ignore, history)
    saved = monotonic()
    for step in loop.run():
        rows.append(np.concatenate([[step.time], measure()]))
        if monotonic() - saved > SAVED_EVERY:
            store.parent.mkdir(parents=True, exist_ok=True)
            partial = store.with_suffix(".part.npz")
            np.savez(partial, rows=np.array(rows), **loop.history.arrays())  # type: ignore[arg-type]
            partial.replace(store)
            saved = monotonic()
    return np.array(rows)


def inversion(system: System) -> str:
    """Say that an element of the fluid is turned inside out, or nothing."""
    domain = system.domain
    rule = {ng.ET.TRIG: ng.IntegrationRule(ng.ET.TRIG, 2 * system.unknowns.order)}
    points = domain.mesh.MapToAllElements(rule, domain.materials(*domain.regions))
    J = ng.Det(ng.Id(2) + ng.Grad(system.state.components[0]))
    smallest = float(np.min(J(points)))
    return "" if smallest > 0 else f"elements are turned inside out (smallest det F {smallest:.3g})"


def at_rest(case: Case) -> tuple[System, Domain]:
    """Return the system of a case with all rates zero and the loads of t = 0."""
    domain = Domain.build(case.geometry)
    system = System(case, domain)
    system.set_steady()
    system.set_loads(0.0)
    return system, domain


def _ignore(_line: Any) -> None:
    return None
