"""How far the laws of mesh motion follow a vein that collapses."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
import pytest

from ngfsi.config.functions import PressureRamp
from ngfsi.linear.backends import choose_backend
from ngfsi.measure.deformation import Deformation
from ngfsi.physics.kinematics import Kinematics
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.system.system import System
from tests.vein import TISSUE, TUBE, case_of, steady, system_of

FINER = TUBE.replace(**{"mesh.element": "mixed", "mesh.lumen_radii": (0.6,)})


def dented(loss: float) -> ng.CoefficientFunction:
    """Displacement of the wall to an outline like an 8, whose waist is the narrower, the more area it loses."""
    x, y = ng.x, ng.y
    wide, waist = 1 + 0.56 * loss, loss / 0.8 * (1 - loss)
    cosine = (x * x - y * y) / (x * x + y * y)
    height = (1 - loss) / wide + waist * (0.5 + cosine)
    return ng.CF(((wide - 1) * x, (height - 1) * y, 0))


def flattened(loss: float) -> ng.CoefficientFunction:
    """Displacement of the wall to an ellipse."""
    return ng.CF((0.3 * ng.x, ((1 - loss) / 1.3 - 1) * ng.y, 0))


def follow(law: str, shape: Any, *losses: float) -> tuple[System, float]:
    """Return the system whose mesh has followed the wall, and the smallest det F in the lumen; the solids do not move.

    Losses: of area, from one to the next.
    """
    system = system_of(case_of(FINER, **{"discretisation.mesh_motion": law}))
    system.set_steady()
    mesh, given = Newton(system, choose_backend("auto"), "e"), ng.GridFunction(system.unknowns.space)
    part = system.unknowns.blocks["d"]
    for loss in losses:
        given.components[0].Set(shape(loss), definedon=system.domain.boundaries("interface"))
        system.values[part] = given.vec.FV().NumPy()[part]
        mesh.solve(1e-8, 30)
    return system, Deformation(system).smallest_jacobian("fluid")


def test_laplace_s_equation_keeps_a_linear_map() -> None:
    """An ellipse with a tenth of the area: det F is that everywhere."""
    system, smallest = follow("harmonic", flattened, 0.9)
    assert smallest == pytest.approx(0.1, rel=1e-9)
    J = Kinematics(ng.Grad(system.motion)).J
    volume = ng.Integrate(J * system.domain.dx("fluid", bonus_intorder=4), system.domain.mesh)
    assert volume == pytest.approx(0.1 * system.domain.volume("fluid"), rel=1e-9)


def test_only_the_elastic_law_follows_into_a_dent() -> None:
    """A waist that is not convex folds what Laplace's equation makes of the mesh."""
    losses = tuple(np.arange(0.02, 0.81, 0.02))
    assert follow("harmonic", dented, 0.8)[1] < 0
    assert follow("elastic", dented, *losses)[1] > 0.02


def test_a_vein_loses_four_fifths_of_its_area() -> None:
    """Buckled, in tissue and wall of a law that stays stable, under a pressure that grows."""
    changes = {"materials.wall": TISSUE, "discretisation.mesh_motion": "elastic", "time.step": 0.025, "time.end": 1.0}
    case = case_of(TUBE, **changes, **{"loads.skin_pressure": PressureRamp(final=20e3, duration=1.0)})
    system, newton = steady(case)
    deformation = Deformation(system)
    J = Kinematics(ng.Grad(system.motion)).J
    measure, given = system.domain.dx("fluid", bonus_intorder=4), system.domain.volume("fluid")
    for _ in TimeLoop(case, system, newton, deformation.inversion).run():
        left = ng.Integrate(J * measure, system.domain.mesh) / given
        if left < 0.2:
            break
    assert left < 0.2
    assert deformation.smallest_jacobian("fluid") > 0
    assert deformation.unstable("wall") == deformation.unstable("tissue") == ""
