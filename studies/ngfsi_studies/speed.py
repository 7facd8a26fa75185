"""Cases and variants of `ngfsi bench`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import TubeSegment

from ngfsi.bench.engine import Setup
from ngfsi.case import Case, Conditions, Discretisation, Loads, Materials, Output, TimeStepping
from ngfsi.config.functions import FlowRamp, PressureConstant, PressureRamp
from ngfsi.materials import Hencky, SolidLaw
from ngfsi.transport.models import Age
from ngfsi.units import MMHG
from ngfsi_studies import closing_vein, living_tissue
from ngfsi_studies.compare_tissues import LEVELS, MAIN, case, mesh
from ngfsi_studies.verification.plane import refined
from ngfsi_studies.verification.turek_hron import BEAM_IN_CHANNEL, rising_case


def _vein(mesh: MeshSettings, end: float = 0.2, **more: Any) -> Case:
    """Return a straight vein in a cylinder of Mooney-Rivlin tissue, clamped, under 10 mmHg after 0.2 s.

    Args:
        more: further loads.
    """
    return Case(
        name="vein",
        geometry=TubeSegment(length=60e-3, outer_radius=30e-3, mesh=mesh),
        materials=Materials.from_dict(
            {"tissue": {"set": "mooney_rivlin_s1"}, "wall": {"set": "vein_wall_source"}, "fluid": {"set": "blood"}}
        ),
        loads=Loads(skin_pressure=PressureRamp(final=10 * MMHG, duration=0.2), **more),
        conditions=Conditions(ends="clamped"),
        discretisation=Discretisation(order=2),
        time=TimeStepping(step=0.01, end=end, scheme="backward_euler"),
        output=Output(fields_every=0),
    )


def _rising(mesh: MeshSettings) -> Case:
    """Return the same vein without pressure at its outlet, whose flow rises from nothing in 0.05 s."""
    flow = FlowRamp(initial=0.0, final=2.913e-6, duration=0.05)
    return _vein(mesh, inlet_flow=flow, outlet_pressure=PressureConstant(value=0.0))


def _straight_tetrahedra(far: float, near: float, layers: int, radii: tuple[float, ...]) -> MeshSettings:
    return MeshSettings(element="tetrahedron", far_size=far, vein_size=near, axial_layers=layers, lumen_radii=radii,
                        curving_order=1)  # fmt: skip


def _mixed(far: float, near: float, layers: int, radii: tuple[float, ...]) -> MeshSettings:
    return MeshSettings(element="mixed", far_size=far, vein_size=near, axial_layers=layers, lumen_radii=radii,
                        curving_order=2)  # fmt: skip


def _million() -> Case:
    """Return the calf with a million unknowns in its tissue, and the vein as coarse as it may be."""
    elements = _mixed(4.2e-3, 3.2e-3, 20, (0.85, 0.55)).replace(curving_order=3)
    return case(MAIN[0], LEVELS["demo"]._replace(mesh=elements)).replace(**{"solver.linear": "p_multigrid"})


CASES: dict[str, Case] = {
    "tiny": _vein(_mixed(25e-3, 6e-3, 2, (0.6,)), end=0.05),
    "vein": _vein(_mixed(14e-3, 3.2e-3, 6, (0.85, 0.55))),
    "vein-layers": _vein(mesh(2.5, 3)).replace(**{"discretisation.order": 3}),
    "vein-tetrahedra": _vein(_straight_tetrahedra(13e-3, 4.4e-3, 10, (0.6,))),
    "rising-20k": _rising(_straight_tetrahedra(15e-3, 5.0e-3, 9, (0.6,))),
    "rising-30k": _rising(_straight_tetrahedra(11e-3, 3.7e-3, 12, (0.6,))),
    "rising-50k": _rising(_straight_tetrahedra(8e-3, 2.8e-3, 16, (0.6,))),
    "rising-80k": _rising(_straight_tetrahedra(6.3e-3, 2.2e-3, 20, (0.6,))),
    "rising-800k": _rising(_straight_tetrahedra(2.75e-3, 0.95e-3, 46, (0.7, 0.4))),
    "turek-hron-fsi2": rising_case("FSI2", refined(BEAM_IN_CHANNEL, order=3, h=1.0), step=0.01, end=4.0),
    **{f"calf-{level}": case(MAIN[0], LEVELS[level]) for level in LEVELS},
    "calf-million": _million(),
    "oval": closing_vein.case(closing_vein.BASE, closing_vein.LEVELS["demo"]),
}
"""tiny: for the guard of counts; vein: 20 steps of backward Euler, vein-tetrahedra the same on 3,700 straight
tetrahedra, as other codes have solved it, vein-layers on two layers of order 3; rising: on tetrahedra of five sizes,
with a flow that rises; turek-hron-fsi2: a beam in the plane, its first seconds; calf: the main study's, Mooney-Rivlin
tissue; calf-million: an hour and a half and 14 GB; oval: the vein of closing_vein at level demo, half closed in 20
steps."""

SHORT = ("vein", "calf-demo")
"""Cases of seconds or a minute, which are run unless others are named."""


def _textbook(plain: Case) -> Case:
    """Return what one writes without effort: Netgen's tetrahedra of default sizes, second order, Newton's method."""
    chosen = _newton_by_umfpack(plain)
    if not _is_segment(plain):
        return chosen
    mesh = {"geometry.mesh.element": "csg", "geometry.mesh.curving_order": 2}
    return chosen.replace(**{"discretisation.order": 2, **mesh})


def _newton_by_umfpack(plain: Case) -> Case:
    return plain.replace(**{"solver.linearise": "always", "solver.linear": "umfpack"})


def _on_tetrahedra(plain: Case) -> Case:
    """Return a case on tetrahedra, unless it is one of the plane."""
    return plain.replace(**{"geometry.mesh.element": "tetrahedron"}) if _is_segment(plain) else plain


def _is_segment(plain: Case) -> bool:
    return hasattr(plain.geometry.mesh, "element")


def _of_tissue(plain: Case, change: Callable[[SolidLaw], SolidLaw]) -> Case:
    """Return a case with another law of its tissue, unless it has none."""
    tissue = plain.materials.tissue
    return plain.replace(**{"materials.tissue": change(tissue)}) if tissue else plain


def _fibred(tissue: SolidLaw) -> SolidLaw:
    return living_tissue.reinforced(tissue, living_tissue.ALONG)


def _viscous(tissue: SolidLaw) -> SolidLaw:
    return tissue.replace(viscosity=living_tissue.viscosity("series", float(tissue.shear_modulus or 0.0)))


def _hencky(tissue: SolidLaw) -> SolidLaw:
    young, poisson = float(tissue.youngs_modulus or 0.0), float(tissue.poissons_ratio or 0.0)
    return Hencky(young=young, poisson=poisson, density=tissue.density)


VARIANTS: dict[str, Callable[[Case], Setup]] = {
    "textbook": lambda plain: Setup(_textbook(plain)),
    "textbook-same-size": lambda plain: Setup(_on_tetrahedra(_newton_by_umfpack(plain))),
    "newton": lambda plain: Setup(plain.replace(**{"solver.linearise": "always"})),
    "single": lambda plain: Setup(plain.replace(**{"solver.linear": "pardiso_single"})),
    "p_multigrid": lambda plain: Setup(plain.replace(**{"solver.linear": "p_multigrid"})),
    "umfpack": lambda plain: Setup(plain.replace(**{"solver.linear": "umfpack"})),
    "tetrahedra": lambda plain: Setup(_on_tetrahedra(plain)),
    "without-contact": lambda plain: Setup(plain.replace(**{"conditions.contact": None})),
    "fibres": lambda plain: Setup(_of_tissue(plain, _fibred)),
    "prony": lambda plain: Setup(_of_tissue(plain, _viscous)),
    "hencky": lambda plain: Setup(_of_tissue(plain, _hencky)),
    "age": lambda plain: Setup(plain.replace(scalars=(Age(),))),
    "one-thread": lambda plain: Setup(plain, threads=1),
}
"""textbook: Newton's method with a fresh factorisation by UMFPACK in every iteration, on Netgen's tetrahedra of default
sizes and second order; textbook-same-size: on tetrahedra of the case's own sizes and order; newton: with the linear
solver and the mesh as they are; single: factors of single precision; without-contact: the mesh of the
blood moves by `discretisation.mesh_motion`; fibres, prony, hencky: tissue of the same moduli with one family of fibres,
with two Maxwell elements, of Hencky's law; age: the blood carries its age; one-thread: what threads gain."""
