"""Means over faces and volumes that are stretched unevenly: over the deformed shape, by quadrature of closed forms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from numpy.typing import NDArray

from ngfsi.case import Cuff
from ngfsi.config.functions import PressureConstant
from ngfsi.materials import SaintVenantKirchhoff
from ngfsi.measure.probe import Probe
from ngfsi.physics.fields import PRESSURE
from ngfsi.system.system import System
from tests.runs import row
from tests.vein import BLOOD, TUBE, case_of, position, set_motion, system_of, value_of

Array = NDArray[np.float64]

FLAT = TUBE.replace(**{"mesh.curving_order": 1, "mesh.axial_layers": 2})
"""Of flat elements, on which polynomials of the elements' order are what they are."""
LENGTH, EDGES = TUBE.length, 10
APOTHEM, EDGE = TUBE.lumen_radius * np.cos(np.pi / EDGES), 2 * TUBE.lumen_radius * np.sin(np.pi / EDGES)
"""Of the lumen's polygon."""
STRETCHING, SHEAR = 0.8, 40.0
WALL = SaintVenantKirchhoff(young=133e3, poisson=0.3, density=1060.0)
TISSUE = SaintVenantKirchhoff(young=30e3, poisson=0.2, density=1060.0)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)


def stretch(z: Array) -> Array:
    """Return that along the vein, which grows from the inlet to the outlet."""
    return 1 + STRETCHING * z / LENGTH


def over(values: Callable[[Array], Array], low: float = 0.0, high: float = LENGTH) -> float:
    """Return an integral over a part of the vein."""
    return float((high - low) / 2 * np.dot(WEIGHTS, values((low + high) / 2 + (high - low) / 2 * NODES)))


def mean(values: Callable[[Array], Array]) -> float:
    """Return a mean along the vein as it is, of values by their place in the reference shape."""
    return over(lambda z: values(z) * stretch(z)) / over(stretch)


def stretched(**changes: Any) -> System:
    """Return a system that is longer than its reference shape, the more so the farther from the inlet."""
    given = {"discretisation.order": 3, "materials.wall": WALL, "materials.tissue": TISSUE, **changes}
    system = system_of(case_of(FLAT, **given))
    set_motion(system, STRETCHING / (2 * LENGTH) * ng.CF((0, 0, ng.z**2)))
    return system


def probe_of(system: System) -> Probe:
    probe = Probe(system)
    probe.refresh()
    return probe


def measured(system: System) -> dict[str, float]:
    return row(probe_of(system))


def trace_and_side(law: SaintVenantKirchhoff, z: Array) -> tuple[Array, Array]:
    """Return pressure -tr(sigma)/3 and lateral pressure (Pa) of a law under the stretch along the vein alone."""
    F, E = stretch(z), (stretch(z) ** 2 - 1) / 2
    lateral, along = law.lame * E / F, (law.lame + 2 * law.shear_modulus) * E * F
    return -(2 * lateral + along) / 3, -lateral


def test_pressure_in_and_beside_the_wall() -> None:
    found = measured(stretched())
    exact = {law: mean(lambda z, law=law: trace_and_side(law, z)[0]) for law in (WALL, TISSUE)}  # type: ignore[misc]
    for column, law in (("p_wall_mean_Pa", WALL), ("p_wall_side_Pa", WALL), ("p_tissue_side_Pa", TISSUE)):
        assert found[column] == pytest.approx(exact[law], rel=1e-9), column


def test_pressure_of_the_tissue_on_the_wall() -> None:
    """Around each level of the mesh, the mean with the hat function of its vertices."""
    found = measured(stretched())
    levels = []
    for middle in (0.0, LENGTH / 2, LENGTH):

        def hat(z: Array, middle: float = middle) -> Array:
            return np.maximum(1 - np.abs(z - middle) / (LENGTH / 2), 0.0)

        parts = [(0.0, LENGTH / 2), (LENGTH / 2, LENGTH)]
        sums = [sum(over(lambda z, f=f: f(z) * hat(z) * stretch(z), *part) for part in parts)  # type: ignore[misc]
                for f in (lambda z: trace_and_side(TISSUE, z)[1], np.ones_like)]  # fmt: skip
        levels.append(sums[0] / sums[1])
    outside = np.interp(np.linspace(0, LENGTH, 11), [0.0, LENGTH / 2, LENGTH], levels)
    for station, exact in enumerate(outside):
        inside = found[f"p_blood_z{station:02d}_Pa"]
        assert inside - found[f"p_transmural_z{station:02d}_Pa"] == pytest.approx(exact, rel=1e-9)


def test_pressure_on_the_skin() -> None:
    """Of a cuff that fades over the whole length, by the cubic 3 s^2 - 2 s^3, beside a constant pressure."""
    cuff = Cuff(pressure=PressureConstant(value=2000.0), start=LENGTH / 2, end=1.0, edge=LENGTH)
    system = stretched(**{"loads.cuffs": (cuff,)})
    for name, value in (("in cuff 1", 2000.0), ("on the skin", 300.0)):
        value_of(system, name).Set(value)
    found = measured(system)
    exact = mean(lambda z: 300.0 + 2000.0 * (z / LENGTH) ** 2 * (3 - 2 * z / LENGTH))
    assert found["skin_pressure_mean_Pa"] == pytest.approx(exact, rel=1e-9)
    assert abs(exact / 1300.0 - 1) > 0.05  # the mean over the reference shape


def test_wall_shear_that_grows_along_the_vein() -> None:
    """u_z = c z r^2: on the faces of the polygon the shear is 2 mu c z times their distance from the axis."""
    system = stretched()
    system.velocity_history.components[0].Set(SHEAR / LENGTH * ng.CF((0, 0, ng.z * (ng.x**2 + ng.y**2))))
    system.case = system.case.replace(**{"output.low_shear": shear(LENGTH / 2)})
    probe = probe_of(system)
    found, wall = row(probe), probe.vessels[""].wall
    assert wall.integral(ng.CF(1.0)) == pytest.approx(EDGES * EDGE * over(stretch), rel=1e-9)
    assert found["sawss_Pa"] == pytest.approx(mean(shear), rel=1e-9)
    low = over(stretch, 0, LENGTH / 2) / over(stretch)
    assert found["wss_low_area_1"] == pytest.approx(low, rel=1e-9)
    places = np.linspace(0, LENGTH, 11)  # of the stations in space, and z there in the reference shape
    before = LENGTH / STRETCHING * (np.sqrt(1 + 2 * STRETCHING * places / LENGTH) - 1)
    for station, exact in enumerate(shear(before)):
        assert found[f"wss_z{station:02d}_Pa"] == pytest.approx(exact, rel=1e-6, abs=1e-6 * shear(LENGTH))


def shear(z: Any) -> Any:
    return 2 * BLOOD.viscosity * SHEAR * z / LENGTH * APOTHEM


@pytest.mark.parametrize("share", [1.0, 4.0])
def test_wall_shear_by_the_balance_of_momentum(share: float) -> None:
    """u_z = c r^2 without inertia, with a share of the pressure 4 mu c z that drives it: shear 2 mu c times the
    distance of the faces. What else the pressure drives is on the wall as far as its functions reach, linearly to the
    axis: a third of a prism's volume, two thirds of what it would do to the wall at equilibrium."""
    system = stretched()
    gradient = share * 4 * BLOOD.viscosity * SHEAR
    system.velocity_history.components[0].Set(SHEAR * ng.CF((0, 0, ng.x**2 + ng.y**2)))
    system.named(system.state)[PRESSURE].Set(gradient * (ng.z + STRETCHING / (2 * LENGTH) * ng.z**2))
    value_of(system, "outlet").Set(gradient * LENGTH * (1 + STRETCHING / 2))
    found = measured(system)
    exact = 2 * BLOOD.viscosity * SHEAR * APOTHEM
    assert found["sawss_Pa"] == pytest.approx(exact, rel=1e-6)
    assert found["sawss_consistent_Pa"] == pytest.approx((1 + (share - 1) * 2 / 3) * exact, rel=1e-6)


def test_pressure_at_an_opening() -> None:
    """m_x = k x^2 / 2 widens one half of it, where the pressure p0 + g x is higher: p0 + g k <x^2> over a polygon."""
    widening, rise = 80.0, 1e5
    system = system_of(case_of(FLAT, **{"discretisation.order": 2}))
    x = position()[0]
    set_motion(system, widening / 2 * ng.CF((x * x, 0, 0)))
    system.named(system.state)[PRESSURE].Set(200.0 + rise * x)
    system.reference().Set(1000.0)
    found = measured(system)
    moment = (6 * TUBE.lumen_radius**2 - EDGE**2) / 24
    for column in ("pressure_inlet_Pa", "pressure_outlet_Pa"):
        assert found[column] - 1200.0 == pytest.approx(rise * widening * moment, rel=1e-9)
