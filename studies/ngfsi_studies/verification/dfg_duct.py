"""Steady flow around a cylinder that crosses a duct (DFG benchmark 3D-1Z)."""

from __future__ import annotations

from ngfsi_geometry.channel import CylinderInDuct, CylinderMesh

from ngfsi.case import Materials
from ngfsi.linear.backends import choose_backend
from ngfsi.measure.force import Force
from ngfsi.solve.initial import steady_flow
from ngfsi.verify import Benchmark, Reference, Setting, Values
from ngfsi_studies.verification.dfg_cylinder import FLUID, SPEED, coefficient
from ngfsi_studies.verification.plane import at_rest, case_of, refined

DUCT = CylinderInDuct(mesh=CylinderMesh(far_size=0.15, cylinder_size=0.03, grading=0.3))


def compute(setting: Setting) -> Values:
    """Return the coefficients of drag and lift."""
    geometry = refined(DUCT, setting["order"], setting["h"]).replace(layers=setting["layers"])
    system, _ = at_rest(case_of(geometry, SPEED * DUCT.height**2, Materials(fluid=FLUID)))
    steady_flow(system, choose_backend("auto"))
    drag, lift, _ = coefficient(SPEED) / DUCT.height * Force(system, "cylinder")()
    return {"drag coefficient": drag, "lift coefficient": lift}


CASE = Benchmark(
    title="DFG 3D-1Z: steady flow around a cylinder across a duct",
    solves="flow at a Reynolds number of 20 in a square duct around a cylinder from wall to wall (prisms)",
    exact="published values; lift is 1.5e-3 of drag",
    compute=compute,
)
LEVELS = {
    "ci": {"k = 2": ({"order": 2, "layers": 3, "h": 1.5},)},
    "full": {"k = 3": tuple({"order": 3, "layers": n, "h": h} for n, h in ((4, 1.0), (8, 0.6)))},
}
SOURCE = "M. Braack, T. Richter, Comput Fluids 35 (2006) 372"
REFERENCES = (
    Reference("drag coefficient", 6.18533, "1", {"k = 2": 3e-3, "k = 3": 1e-3}, SOURCE),
    Reference("lift coefficient", {"k = 3": 0.009401}, "1", 0.1, SOURCE),
)
