"""Taylor's test for each law of solids and fluids, opening and condition that is registered; reciprocity of loads."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from netgen.occ import Circle, Face, Glue, OCCGeometry, Pnt, Wire, Z
from ngfsi_geometry.channel import PlaneMesh
from ngfsi_geometry.lofted import LoftedMesh, LoftedVein

from ngfsi import registry
from ngfsi.case import Case, Materials
from ngfsi.config.functions import FlowConstant
from ngfsi.gradient.parameters import Parameter, parameters_of
from ngfsi.gradient.window import Window
from ngfsi.materials import load_set
from ngfsi.solve.statics import section_case
from tests.geometry.test_lofted import ellipse
from tests.gradient.test_gradient import VEIN, gradient, moved, value
from tests.materials.test_varying import EXAMPLES
from tests.solve import test_rigid, test_statics

AT_REST: dict[str, Any] = {"time.scheme": "static", "time.step": 0.1, "time.end": 0.1}
RING = test_statics.case_of("tibia", skin=500.0).replace(
    **{"time.scheme": "static", "geometry.mesh": PlaneMesh(far_size=16e-3, curving_order=2)}
)
SEGMENT = VEIN.replace(**AT_REST)
BONE = 3e-3
"""Radius (m)."""
CURVE = {"kind": "constant", "value_Pa": 1500.0}
OPENINGS: dict[str, tuple[str, dict[str, Any]]] = {
    "flow": ("inlet", {"flow": {"kind": "constant", "value_ml_s": 3.0}}),
    "pressure": ("outlet", {"pressure": CURVE}),
    "free": ("outlet", {}),
    "resistance": ("outlet", {"resistance_mmHg_s_ml": 0.75, "distal_pressure": CURVE}),
    "windkessel": ("outlet", {"resistance_mmHg_s_ml": 0.75, "distal_resistance_mmHg_s_ml": 1.5,
                              "compliance_ml_mmHg": 0.1, "distal_pressure": CURVE}),
}  # fmt: skip
FLUIDS = {"newtonian": "blood", "carreau_yasuda": "blood_carreau_yasuda", "cross": "blood_cross",
          "casson": "blood_casson", "quemada": "blood_quemada"}  # fmt: skip
PIPE = LoftedVein(
    outlines=(ellipse(2e-3, 1.5e-3),) * 5, heights=(0.0, 1e-3, 2e-3, 3e-3, 4e-3), inlet_diameters=1.0,
    mesh=LoftedMesh(around=8, layers=1, inlet_layers=1, lumen_radii=(0.6,), curving_order=2),
)  # fmt: skip
"""Of 32 elements, oval and rigid: with walls that move a law of blood that thins takes ten times as long."""
CONDITIONS: dict[str, dict[str, Any]] = {
    "body_force": {"acceleration": [3.0, 5.0, 0.0]},
    "displacement": {"boundaries": ["skin"], "displacement": [0.0, 1e-4, 0.0]},
    "stocking": {"tension_N_m": [20.0]},
}


def ends(all_of_them: list[Parameter]) -> list[Parameter]:
    """Return the first and the last, or the only one."""
    return all_of_them[:: max(len(all_of_them) - 1, 1)]


def changes() -> dict[str, tuple[Case, str, str]]:
    """Return case, quantity and parameters by what is registered: of laws the first modulus and the last, since to the
    gradient, which takes differences of the residual, numbers are alike; but fibres are slack here and taut there."""
    examples = EXAMPLES | {"ogden": EXAMPLES["ogden"] | {"mu": (3e3,), "alpha": (2.5,)}}  # two terms take far longer
    moduli = {name: [key for key, one in given.items() if key not in ("fibres", "density", "volumetric")]
              for name, given in examples.items()}  # fmt: skip
    solid = {f"solid {name}": (
        RING.replace(**{"materials.tissue": {"law": name, **given}}), "skin_area",
        f"materials.tissue.{moduli[name][0]},materials.tissue.{moduli[name][-1]}",
    ) for name, given in examples.items()}  # fmt: skip
    pipe = test_rigid.case_of(PIPE, FlowConstant(value=1e-7))
    fluid = {f"fluid {name}": (
        flow := pipe.replace(**{"materials.fluid": load_set(given)}), "pressure_inlet",
        ",".join(one.name for one in ends(parameters_of(flow, ["materials.fluid"])[1:])),  # without the density
    ) for name, given in FLUIDS.items()}  # fmt: skip
    opening = {f"opening {name}": (
        SEGMENT.replace(**{"loads.openings": {where: {"kind": name, **given}}}), "lumen_volume",
        f"loads.openings.{where}" if given else "loads.inlet_flow",
    ) for name, (where, given) in OPENINGS.items()}  # fmt: skip
    condition = {f"condition {name}": (
        SEGMENT.replace(**{"loads.further": ({"kind": name, **given},)}), "lumen_volume", "loads.further"
    ) for name, given in CONDITIONS.items()}  # fmt: skip
    return solid | fluid | opening | condition


@pytest.mark.parametrize(("group", "known"), [
    ("solid_laws", EXAMPLES), ("fluid_laws", FLUIDS), ("openings", OPENINGS), ("conditions", CONDITIONS),
])  # fmt: skip
def test_all_that_is_registered_is_here(group: str, known: dict[str, Any]) -> None:
    own = {entry.name for entry in registry.installed(f"ngfsi.{group}")}
    assert own == {*known}, "give it an example in this file, or in tests/materials/test_varying.py"


@pytest.mark.parametrize("name", changes())
def test_remainder_is_of_second_order(name: str) -> None:
    """Along one direction of numbers of a law, opening or condition, each changed by 2 % and by 1 %; what depends
    linearly on them leaves nothing."""
    case, quantity, by = changes()[name]
    found = gradient(case, quantity, Window(), by)
    way = np.array([0.02 * one.value * (-1) ** n for n, one in enumerate(found.parameters)])
    slope = sum(found.derivatives[one.name] * change for one, change in zip(found.parameters, way, strict=True))
    left = np.abs([value(moved(case, found.parameters, part * way), quantity, Window()) - found.value - part * slope
                   for part in (1.0, 0.5)])  # fmt: skip
    assert slope
    if left[0] > 1e-4 * abs(slope):
        assert np.log2(left[0] / left[1]) == pytest.approx(2.0, abs=0.1)


class BonedRing(test_statics.Ring):
    """A disc with a hole that blood fills, and a bone beside it."""

    hole: str = "lumen"

    @property
    def rigid_names(self) -> tuple[str, ...]:
        return ("tibia",)

    @property
    def boundary_names(self) -> tuple[str, ...]:
        return "skin", "lumen", "tibia"

    def exact_volumes(self) -> dict[str, float]:
        return {"tissue": np.pi * (test_statics.OUTER**2 - test_statics.INNER**2 - BONE**2)}

    def netgen_mesh(self, attempt: int = 0) -> Any:  # noqa: ARG002 - there is one way
        def disc(x: float, radius: float, name: str) -> Any:
            face = Face(Wire([Circle(Pnt(x, 0, 0), Z, radius)]))
            face.edges.name = name
            return face

        shape = disc(0, test_statics.OUTER, "skin") - disc(0, test_statics.INNER, "lumen") - disc(12e-3, BONE, "tibia")
        shape.faces.name = "tissue"
        return OCCGeometry(Glue([shape]), dim=2).GenerateMesh(maxh=self.mesh.far_size)


def test_loads_are_reciprocal() -> None:
    """Work of one load on the motion by another is that of the other on the motion by the one (Betti), in finite strain
    too where both have a potential: the hole that the skin's pressure takes away is the skin that the blood's adds."""
    case = section_case(BonedRing(), Materials(tissue=test_statics.LAW), skin=800.0, blood=500.0)
    case = case.replace(**{"time.scheme": "static"})
    skin, blood = "loads.skin_pressure.value", "loads.outlet_pressure.value"
    of_hole, of_skin = (gradient(case, quantity, Window(), f"{skin},{blood}").derivatives
                        for quantity in ("lumen_area", "skin_area"))  # fmt: skip
    assert of_hole[skin] == pytest.approx(-of_skin[blood], rel=1e-6, abs=0.0)
    assert abs(of_hole[blood]) < 0.9 * abs(of_hole[skin])
