"""The pocket behind the leaflets of a valve: refusals, and the flow in it as published."""

from __future__ import annotations

from math import pi

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.valve import ValvePocket
from numpy.typing import NDArray

from ngfsi.case import Case, Discretisation, Loads, Materials, TimeStepping
from ngfsi.config.functions import FlowConstant
from ngfsi.errors import GeometryError
from ngfsi.linear.backends import choose_backend
from ngfsi.solve.initial import initial_state
from ngfsi.solve.newton import Newton
from ngfsi.system.system import System
from tests.vein import BLOOD, domain_of

Array = NDArray[np.float64]

VALVE = ValvePocket(upstream=6e-3, downstream=8e-3, leaflet_size=1.6e-3)
PLACES = np.linspace(0.4, 1.7, 14)
"""Over the length of the leaflets."""


def flow(reynolds: float) -> tuple[System, float]:
    """Return steady flow at a Reynolds number of the vein, and its mean velocity (m/s)."""
    mean = reynolds * BLOOD.viscosity / (BLOOD.density * 2 * VALVE.radius)
    case = Case(
        name="valve", geometry=VALVE, materials=Materials(fluid=BLOOD),
        loads=Loads(inlet_flow=FlowConstant(value=mean * pi * VALVE.radius**2)),
        discretisation=Discretisation(order=3), time=TimeStepping(step=1.0, end=1.0, scheme="static"),
    )  # fmt: skip
    system = System(case, domain_of(VALVE))
    initial_state(system, Newton(system, choose_backend("auto")))
    return system, mean


def along_the_wall(system: System, mean: float) -> Array:
    """Return the velocity along the vein, over its mean, close to the wall behind a leaflet: from deep in the pocket to
    the end of the sinus."""
    found = []
    for place in PLACES * VALVE.leaflet_length:
        part = min(place / VALVE.leaflet_length, 1.0)
        leaflet = (1 - part) * VALVE.radius + part * VALVE.opening / 2 + VALVE.thickness
        wall = float(VALVE.wall_radius(VALVE.upstream + place))
        y = wall - 0.12 * (wall - leaflet)
        found.append(system.domain.value(system.fields().velocity, 0.0, y, VALVE.upstream + place)[2])
    return np.array(found) / mean


def speed_in_the_pocket(system: System, mean: float) -> float:
    """Return the mean speed in both pockets over that in the vein."""
    low, start, end = VALVE.opening / 2, VALVE.upstream, VALVE.upstream + VALVE.leaflet_length
    inside = ng.IfPos(ng.sqrt(ng.y**2) - low, 1, 0) * ng.IfPos(ng.z - start, 1, 0) * ng.IfPos(end - ng.z, 1, 0)
    # of the leaflet's line, behind which the pocket lies
    behind = ng.IfPos(
        ng.sqrt(ng.y**2) - VALVE.radius + (ng.z - start) / VALVE.leaflet_length * (VALVE.radius - low), 1, 0
    )
    over, pocket = system.domain.dx("fluid", bonus_intorder=6), inside * behind
    speed = ng.Norm(system.fields().velocity)
    return float(ng.Integrate(pocket * speed * over, system.domain.mesh)
                 / ng.Integrate(pocket * over, system.domain.mesh) / mean)  # fmt: skip


def test_two_vortices_and_stasis_in_the_pocket() -> None:
    """Behind the free edge of each leaflet a vortex, whose flow along the wall goes back into the pocket, and deep in
    the pocket a second one that turns the other way, slower by orders: the blood hardly moves there (T. Karino, M.
    Motomiya, Thromb Res 36, 1984, 245). At a Reynolds number of 5, of a leg that rests."""
    system, mean = flow(5.0)
    profile = along_the_wall(system, mean)
    first, back = int(np.argmin(profile)), int(np.flatnonzero(profile < 0)[-1])
    assert 0.8 < PLACES[first] < 1.15
    assert profile[first] == pytest.approx(-0.0115, rel=0.2)
    # the flow is at the wall again before the sinus ends
    assert 1.05 < PLACES[back] < 1.3
    # eddies in a corner of such an angle are weaker by some hundred times each (H. K. Moffatt, J Fluid Mech 18, 1964)
    second = profile[:4].max()
    assert 5e-4 < second / -profile[first] < 1e-2
    assert speed_in_the_pocket(system, mean) == pytest.approx(0.0043, rel=0.1)


def test_leaflets_that_do_not_fit_are_refused() -> None:
    with pytest.raises(GeometryError, match="opening must leave room for two leaflets"):
        ValvePocket(opening=7.1e-3)
    with pytest.raises(GeometryError, match="leaflet_length must be less than sinus_length"):
        ValvePocket(leaflet_length=15e-3)
