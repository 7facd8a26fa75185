"""Pressure on the vein's wall against Lame's ring, and of the blood against Poiseuille's law."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.segment import MeshSettings
from geometry.tube import TubeSegment
from ngfsi.curves import FlowConstant, PressureConstant
from ngfsi.materials import CompressibleNeoHookean
from ngfsi.measure.transmural import WallLoad
from tests.vein import BLOOD, case_of, steady

INNER, WALL, OUTER, LENGTH = 5e-3, 1.5e-3, 12e-3, 20e-3
SOFT = CompressibleNeoHookean(young=30e3, poisson=0.3, density=0.0)
MESH = MeshSettings(axial_layers=2, far_size=4e-3, vein_size=2.5e-3, lumen_radii=(0.6,), curving_order=3)
BLOOD_PRESSURE, SKIN_PRESSURE, FLOW = 2.0, 5.0, 1e-8


def test_pressure_on_the_wall_and_on_the_axis() -> None:
    tube = TubeSegment(length=LENGTH, lumen_diameter=2 * INNER, wall_thickness=WALL, outer_radius=OUTER, mesh=MESH)
    loads = {
        "loads.outlet_pressure": PressureConstant(value=BLOOD_PRESSURE),
        "loads.skin_pressure": PressureConstant(value=SKIN_PRESSURE),
        "loads.inlet_flow": FlowConstant(value=FLOW),
    }
    system = steady(case_of(tube, **{"materials.tissue": SOFT, "materials.wall": SOFT}, **loads))[0]
    heights = np.linspace(0, LENGTH, 5)
    load = WallLoad(system, heights)
    load.refresh()
    drop = 8 * BLOOD.viscosity * FLOW / (np.pi * INNER**4) * (LENGTH - heights)
    assert load.blood - BLOOD_PRESSURE == pytest.approx(drop, rel=0.02, abs=0.02 * drop[0])
    # the pressures of blood and skin reach the outer face in shares that do not depend on the (single) material
    share = INNER**2 * (OUTER**2 / (INNER + WALL) ** 2 - 1) / (OUTER**2 - INNER**2)
    exact = SKIN_PRESSURE + share * (BLOOD_PRESSURE - SKIN_PRESSURE)
    assert load.tissue == pytest.approx(np.full(5, exact), rel=5e-3)
