"""Where elements are worst: known places of a stretch that varies along the vein."""

from __future__ import annotations

import math
import re

import ngsolve as ng
import pytest

from ngfsi.measure.deformation import Deformation
from ngfsi.system.system import System
from tests.vein import TISSUE, TUBE, WALL, case_of, system_of


@pytest.fixture
def system() -> System:
    return system_of(case_of(TUBE, **{"materials.wall": TISSUE}))


def squeeze(system: System, share: float) -> None:
    """Displace by -share z^2 / L along the vein: det F = 1 - 2 share z / L, smallest at the outlet."""
    system.motion.Set(ng.CF((0, 0, -share * ng.z**2 / TUBE.length)))


def height(text: str) -> float:
    """Return the last of the coordinates (m) in a sentence."""
    (found,) = re.findall(r"near \([^,]*, [^,]*, ([^)]*)\) mm", text)
    return 1e-3 * float(found)


def test_worst_place(system: System) -> None:
    squeeze(system, 0.2)
    deformation = Deformation(system)
    for region in ("tissue", "wall", "fluid"):
        smallest, place = deformation.min_jacobian(region)
        assert smallest == deformation.smallest_jacobian(region)
        z = (1 - smallest) / 0.4 * TUBE.length
        assert 0.85 * TUBE.length < z < TUBE.length
        assert height(f"near {place}") == pytest.approx(z - 0.2 * z**2 / TUBE.length, rel=5e-3)
    assert deformation.inversion() == ""
    assert deformation.approaching() == []
    later, first = (deformation.diagnose_failure(begun=begun) for begun in (True, False))
    assert later.endswith("no element is close to inversion, the vein may have lost its stability")
    assert first.endswith("no step was taken, the loads of the first one may be too large or jump")


@pytest.mark.parametrize(("volume", "close"), [(0.201, False), (0.199, True)])
def test_how_close_to_inversion_is_said(system: System, volume: float, close: bool) -> None:
    """From a fifth of the volume on, in warnings and in what is said of a failure."""
    system.motion.Set(ng.CF((0, 0, (volume - 1) * ng.z)))
    deformation = Deformation(system)
    assert len(deformation.approaching()) == (3 if close else 0)
    assert ("no element is close to inversion" in deformation.diagnose_failure(begun=True)) == (not close)


def test_inversion_is_announced_once_and_named(system: System) -> None:
    deformation = Deformation(system)
    squeeze(system, 0.48)
    warnings = deformation.approaching()
    assert len(warnings) == 3
    assert re.match(r"elements of 'tissue' near \(.*\) mm are close to inversion, det F 0\.[01]", warnings[0])
    assert deformation.approaching() == []
    assert deformation.inversion() == ""
    assert "stability" not in deformation.diagnose_failure(begun=True)
    squeeze(system, 0.7)
    said = deformation.inversion()
    assert said.startswith("elements of 'tissue' invert near (")
    assert height(said) < 0.7 * TUBE.length
    only_blood = Deformation(system)
    only_blood._points = {"fluid": only_blood._points["fluid"]}
    assert only_blood.inversion().startswith("the mesh of the blood is folded near (")


def test_lost_stability_of_a_material_is_announced_once_and_named() -> None:
    """In Saint Venant's wall squeezed along the vein alone by a: a band across it slides once S33 + mu < 0."""
    system = system_of(case_of(TUBE))
    deformation = Deformation(system)
    squeeze = 1 - math.sqrt(1 - 2 * WALL.shear_modulus / (WALL.lame + 2 * WALL.shear_modulus))
    for share in (0.99, 1.01):
        system.motion.Set(ng.CF((0, 0, -share * squeeze * ng.z)))
        lost = share > 1
        warnings = deformation.approaching()
        assert len(warnings) == (1 if lost else 0)
        assert (" and the material of 'wall' near (" in deformation.diagnose_failure(begun=True)) is lost
    assert re.match(r"the material of 'wall' near \(.*\) mm has lost strong ellipticity: saint_venant_kir", warnings[0])
    assert deformation.approaching() == []
