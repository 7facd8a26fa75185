"""A second vein in the calf: both are measured, and far apart each is what it is alone."""

from __future__ import annotations

from typing import Any

import pytest
from ngfsi_geometry.calf import CalfSegment, CalfVein
from ngfsi_geometry.segment import MeshSettings

from ngfsi.case import Case, Discretisation, Loads, Materials, TimeStepping
from ngfsi.conditions import FlowOpening, PressureOpening
from ngfsi.config.functions import FlowConstant, PressureConstant, PressureRamp
from ngfsi.materials import load_set
from tests.runs import Run, computed

MESH = MeshSettings(
    element="mixed", axial_layers=2, far_size=30e-3, vein_size=6e-3, lumen_radii=(0.6,), curving_order=2
)
FINER = MESH.replace(far_size=20e-3, vein_size=4e-3)
FIRST = {"vein_x": 22e-3, "vein_y": -24e-3, "lumen_diameter": 8e-3}
SECOND = {"vein_x": -28e-3, "vein_y": -18e-3, "lumen_diameter": 6e-3}
LOADS = {"first": (2e-6, 1333.0), "second": (1e-6, 1000.0)}
"""Of each vein: inflow (m3/s) and pressure at the outlet (Pa)."""


def run_of(which: str, further: tuple[CalfVein, ...] = (), mesh: MeshSettings = MESH, **more: Any) -> Run:
    """Return the run of the calf with a vein under a pressure that begins to rise, and perhaps with further ones."""
    flow, pressure = LOADS[which]
    place = FIRST if which == "first" else SECOND
    loads = Loads(
        skin_pressure=PressureRamp(final=1500.0, duration=0.2),
        inlet_flow=FlowConstant(value=flow),
        outlet_pressure=PressureConstant(value=pressure),
        **more,
    )
    case = Case(
        name="calf",
        geometry=CalfSegment(length=40e-3, mesh=mesh, further_veins=further, **place),
        materials=Materials(
            tissue=load_set("mooney_rivlin_s1"), wall=load_set("vein_wall_source"), fluid=load_set("blood")
        ),
        loads=loads,
        discretisation=Discretisation(order=2),
        time=TimeStepping(step=0.1, end=0.2),
    )
    return computed(case)


def loss(run: Run, vein: str = "") -> float:
    """Return the lost part of a lumen's volume."""
    volume = run[f"{vein}lumen_volume_m3"]
    return float(1 - volume[-1] / volume[0])


def test_each_of_two_veins_is_what_it_is_alone() -> None:
    """To what a finer mesh changes: the loss of volume, and the gain of wall shear stress under the blood's flow."""
    flow, pressure = LOADS["second"]
    openings = {
        "inlet_2": FlowOpening(flow=FlowConstant(value=flow)),
        "outlet_2": PressureOpening(pressure=PressureConstant(value=pressure)),
    }
    beside = CalfVein(lumen_diameter=SECOND["lumen_diameter"], x=SECOND["vein_x"], y=SECOND["vein_y"])
    both = run_of("first", (beside,), openings=openings)
    for which, vein in (("first", ""), ("second", "vein_2_")):
        alone, finer = run_of(which), run_of(which, mesh=FINER)
        mesh_error = abs(loss(alone) / loss(finer) - 1)
        assert mesh_error < 3e-3
        assert loss(both, vein) == pytest.approx(loss(alone), rel=mesh_error)
        assert both[f"{vein}sawss_Pa"] == pytest.approx(alone["sawss_Pa"], rel=mesh_error)
        inflow, outflow, rate = (both[f"{vein}{name}_m3_s"] for name in ("flow_in", "flow_out", "lumen_volume_rate"))
        assert inflow == pytest.approx(LOADS[which][0], rel=1e-9)
        assert outflow - inflow == pytest.approx(-rate, rel=1e-6, abs=1e-6 * LOADS[which][0])
    assert loss(both, "vein_2_") != pytest.approx(loss(both), rel=0.02)
    # each at its own outlet, where the traction is that of developed flow
    for name, (_, given) in zip(("outlet", "outlet_2"), LOADS.values(), strict=True):
        assert both[f"pressure_{name}_Pa"] == pytest.approx(given, abs=1.0)
