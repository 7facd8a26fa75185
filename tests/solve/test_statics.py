"""Plane sections in equilibrium: plane stress and strain, small strain, prescribed skin."""

from __future__ import annotations

from typing import Any, ClassVar

import ngsolve as ng
import numpy as np
import pytest
from netgen.occ import Circle, Face, Glue, OCCGeometry, Pnt, Wire, Z
from ngfsi_geometry.channel import PlaneMesh, PlaneSection
from scipy.optimize import brentq

from ngfsi.case import Case, Conditions, Materials, TimeStepping
from ngfsi.config.functions import PressureRamp
from ngfsi.errors import CaseError
from ngfsi.materials import CompressibleNeoHookean
from ngfsi.measure.plane import PlaneSectionProbe
from ngfsi.mesh.geometry import Vessel
from ngfsi.outlines.displacement import OutlineDisplacement
from ngfsi.outlines.outline import Outline
from ngfsi.physics.fields import STRETCH
from ngfsi.run.observers import volume_fields
from ngfsi.solve.statics import equilibrium, section_case
from ngfsi.store.fields import STRESS
from ngfsi.system.system import System
from tests.runs import computed
from tests.vein import domain_of

LAW = CompressibleNeoHookean(young=12e3, poisson=0.4, density=1060.0)
INNER, OUTER = 6e-3, 20e-3


class Ring(PlaneSection):
    """A ring around a bone (`bone=True`), around a pressurised lumen, or a full disc."""

    solids: ClassVar[tuple[str, ...]] = ("tissue",)
    fluid: ClassVar[str | None] = None
    hole: str = "tibia"
    mesh: PlaneMesh = PlaneMesh(far_size=8e-3, curving_order=4)

    @property
    def rigid_names(self) -> tuple[str, ...]:
        return ("tibia",) if self.hole == "tibia" else ()

    @property
    def vessels(self) -> tuple[Vessel, ...]:
        hole = Vessel(lumen=None, interface="lumen", wall=None, outer=None, inlets=(), outlets=(), radius=INNER)
        return (hole,) if self.hole == "lumen" else ()

    @property
    def boundary_names(self) -> tuple[str, ...]:
        return "skin", *((self.hole,) if self.hole else ())

    @property
    def size(self) -> float:
        return INNER

    def inflow(self) -> Any:
        return

    def exact_volumes(self) -> dict[str, float]:
        return {"tissue": np.pi * (OUTER**2 - (INNER**2 if self.hole else 0))}

    def netgen_mesh(self, attempt: int = 0) -> Any:  # noqa: ARG002 - there is one way
        def disc(radius: float, name: str) -> Any:
            face = Face(Wire([Circle(Pnt(0, 0, 0), Z, radius)]))
            face.edges.name = name
            return face

        shape = disc(OUTER, "skin")
        if self.hole:
            shape = shape - disc(INNER, self.hole)
        shape.faces.name = "tissue"
        return OCCGeometry(Glue([shape]), dim=2).GenerateMesh(maxh=self.mesh.far_size)


def case_of(hole: str, skin: float = 0.0, blood: float = 0.0, **conditions: Any) -> Case:
    return section_case(
        Ring(hole=hole), Materials(tissue=LAW), skin=skin, blood=blood, conditions=Conditions(**conditions)
    )


@pytest.mark.parametrize("plane_stress", [(), ("tissue",)])
def test_ring_around_a_bone(plane_stress: tuple[str, ...]) -> None:
    """Small strain: u = A r + B / r with u = 0 at the bone and sigma_rr = -p on the skin (Lame)."""
    p, mu = 2e3, LAW.shear_modulus
    case = case_of("tibia", skin=p, strain="small", plane_stress=plane_stress)
    system = equilibrium(case, domain_of(case.geometry))
    lame = LAW.young * LAW.poisson / (1 - LAW.poisson**2) if plane_stress else LAW.lame
    # sigma_rr = 2 (lame + mu) A - 2 mu B / r^2, B = -A INNER^2
    A = -p / (2 * (lame + mu) + 2 * mu * (INNER / OUTER) ** 2)
    exact = A * OUTER - A * INNER**2 / OUTER
    assert system.motion(system.domain.mesh(OUTER * 0.999, 0))[0] == pytest.approx(exact, rel=3e-3)
    skin = PlaneSectionProbe(system).enclosed_area("skin")
    assert skin == pytest.approx(np.pi * (OUTER + exact) ** 2, rel=1e-5)
    # the trace of the stress is the same everywhere
    in_plane = 4 * (lame + mu) * A
    across = 0.0 if plane_stress else 2 * lame * A
    pressure = PlaneSectionProbe(system).pressure_over("tibia", "tissue")
    assert pressure == pytest.approx(-(in_plane + across) / 3, rel=2e-3)
    stress = volume_fields(system)[STRESS](system.domain.mesh(12e-3, 5e-3))
    assert stress[0] + stress[4] == pytest.approx(in_plane, rel=2e-3)
    assert stress[8] == pytest.approx(across, rel=2e-3, abs=1e-3 * p)


def test_means_over_a_shape_that_is_stretched_unevenly() -> None:
    """m_x = k (x^2 / 2 + r x): over the deformed outline of the hole and the deformed region, by closed forms."""
    widening = 60.0
    case = case_of("tibia")
    system = System(case, domain_of(case.geometry))
    system.motion.Set(widening * ng.CF((ng.x**2 / 2 + INNER * ng.x, 0)))
    angle = 2 * np.pi * np.arange(400) / 400
    J = 1 + widening * INNER * (np.cos(angle) + 1)  # F = diag(J, 1, 1)
    size = np.hypot(np.cos(angle), J * np.sin(angle))
    pressure = -(LAW.shear_modulus * (J**2 - 1) + 3 * LAW.lame * np.log(J)) / (3 * J)
    exact = np.average(pressure, weights=size)
    assert abs(pressure.mean() / exact - 1) > 0.02
    probe = PlaneSectionProbe(system)
    assert probe.pressure_over("tibia", "tissue") == pytest.approx(exact, rel=1e-4)
    area = case.geometry.exact_volumes()["tissue"] * (1 + widening * INNER)
    assert probe.region_area("tissue") == pytest.approx(area, rel=1e-5)
    assert probe.enclosed_area("skin") == pytest.approx(np.pi * OUTER**2 * (1 + widening * INNER), rel=1e-5)


def test_pressure_in_a_lumen_widens_it() -> None:
    """Small plane strain of a thick tube whose skin is held: u(INNER) from Lame with u(OUTER) = 0."""
    held = OutlineDisplacement.between(Outline.circle(0, 0, OUTER).points, Outline.circle(0, 0, OUTER).points)
    case = case_of("lumen", blood=1e3, strain="small", skin_displacement=held)
    probe = PlaneSectionProbe(equilibrium(case, domain_of(case.geometry)))
    mu, lame = LAW.shear_modulus, LAW.lame
    A = -1e3 / (2 * (lame + mu) + 2 * mu * (OUTER / INNER) ** 2)
    exact = A * INNER - A * OUTER**2 / INNER
    assert exact > 0
    assert probe.enclosed_area("lumen") == pytest.approx(np.pi * (INNER + exact) ** 2, rel=1e-5)


def test_homogeneous_plane_stress_at_finite_strain() -> None:
    """A disc whose skin moves by a linear map: the stretch across makes P33 vanish, found here by bisection."""
    F = np.array([[0.8, 0.1], [0.05, 0.9]])
    before = Outline.circle(0, 0, OUTER).points
    moved = OutlineDisplacement.between(before, before @ F.T)
    case = case_of("", skin_displacement=moved, plane_stress=("tissue",))
    system = equilibrium(case, domain_of(case.geometry))

    def normal_stress(stretch: float) -> float:
        J = np.linalg.det(F) * stretch
        step = 1e-6

        def energy(s: float) -> float:
            full = np.zeros((3, 3))
            full[:2, :2], full[2, 2] = F, s
            value = LAW.energy(ng.CF(tuple(full.ravel()), dims=(3, 3)))
            return float(value(system.domain.mesh(1e-3, 1e-3)))

        assert J > 0
        return (energy(stretch + step) - energy(stretch - step)) / (2 * step)

    exact = brentq(normal_stress, 1.0, 2.0)
    stretch = system.named(system.state)[STRETCH]
    values = [1 + stretch(system.domain.mesh(x, y)) for x, y in ((0.0, 0.0), (9e-3, 4e-3), (-15e-3, -3e-3))]
    assert values == pytest.approx([exact] * 3, rel=2e-5)
    m = system.motion(system.domain.mesh(9e-3, 4e-3))
    assert m == pytest.approx((F - np.eye(2)) @ [9e-3, 4e-3], rel=2e-4)


def test_small_and_finite_strain_agree_for_small_loads_only() -> None:
    losses = {}
    for strain in ("small", "finite"):
        for p in (1.0, 4e3):
            case = case_of("tibia", skin=p, strain=strain, plane_stress=("tissue",))
            probe = PlaneSectionProbe(equilibrium(case, domain_of(case.geometry)))
            losses[strain, p] = np.pi * OUTER**2 - probe.enclosed_area("skin")
    assert losses["finite", 1.0] == pytest.approx(losses["small", 1.0], rel=5e-4)
    assert losses["finite", 4e3] < 0.9 * losses["small", 4e3]


def test_a_run_ends_where_equilibrium_does() -> None:
    """Loads that grow over three static steps give the state that they give at once."""
    case = case_of("tibia", skin=4e3)
    ramp = PressureRamp(final=4e3, duration=1.0)
    time = TimeStepping(scheme="static", step=0.4, end=1.0)
    followed = computed(case.replace(time=time, **{"loads.skin_pressure": ramp}))
    at_once = equilibrium(case, domain_of(case.geometry))
    assert [step.time for step in followed.steps] == pytest.approx([0.4, 0.8, 1.0])
    assert followed.states[-1] == pytest.approx(at_once.values, rel=1e-6, abs=1e-12)
    assert followed["skin_area_m2"][-1] == pytest.approx(PlaneSectionProbe(at_once).enclosed_area("skin"), rel=1e-9)


def test_refusals() -> None:
    with pytest.raises(CaseError, match=r"conditions.plane_stress' names muscle: the solids of Ring are tissue"):
        case_of("tibia", plane_stress=("muscle",))
    with pytest.raises(CaseError, match="these are for solids without fluid"):
        case_of("tibia", plane_stress=("tissue",), initial_state="prestress")
