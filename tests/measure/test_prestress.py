"""A shape that carries stress, and the vein that came to it from the one without: all that is measured is the same."""

from __future__ import annotations

from typing import Any, ClassVar

import ngsolve as ng
import numpy as np
import pytest
from numpy.typing import NDArray

from ngfsi.materials import CompressibleNeoHookean
from ngfsi.materials.solid.law import Place, SolidModel
from ngfsi.measure.deformation import Deformation
from ngfsi.measure.ellipticity import Ellipticity
from ngfsi.measure.energy import Energy
from ngfsi.measure.probe import Probe
from ngfsi.measure.stability import Stability
from ngfsi.run.observers import volume_fields
from ngfsi.store.fields import DEFORMATION, STRESS
from ngfsi.system.system import System
from tests.runs import row
from tests.vein import COARSE, WALL, BonedTube, case_of, position, set_motion, system_of, value_of

Array = NDArray[np.float64]

G = np.array([[1.1, 0.15, 0.0], [-0.1, 0.85, 0.0], [0.0, 0.0, 1.0]])
"""Takes the shape that is free of stress to the one that is not; planes across the vein stay what they are."""
FLAT = COARSE.replace(curving_order=1, axial_layers=2)
AT = np.array([[10e-3, 1e-3, 3e-3], [0.0, 6.5e-3, 8e-3], [-6.5e-3, 1e-3, 4e-3]])
"""Points of the tissue and, twice, of the wall, of the shape without stress."""
OF_THE_REFERENCE = {"displacement_max_m", "detF_min_tissue_1", "detF_min_wall_1", "detF_min_fluid_1"}


class Carrying(BonedTube):
    """The shape into which G takes a vein of flat elements."""

    def netgen_mesh(self, attempt: int = 0) -> Any:
        mesh = super().netgen_mesh(attempt)
        points = mesh.Coordinates()
        points[:] = points @ G.T
        return mesh


class Noting(CompressibleNeoHookean):
    """A law that notes where it is bound."""

    places: ClassVar[list[Place]] = []

    def bind(self, place: Place) -> SolidModel:
        self.places.append(place)
        return super().bind(place)


TISSUE = Noting(young=30e3, poisson=0.3, density=1060.0)


def matrix(values: Array) -> ng.CoefficientFunction:
    return ng.CF(tuple(values.ravel().tolist()), dims=(3, 3))


@pytest.fixture(scope="module")
def pair() -> tuple[System, System]:
    """A vein without prestress, and the same one in the same state from the shape that carries stress."""
    flat = {"discretisation.order": 2}
    heavy = {  # as much mass in another volume
        f"materials.{name}": law.replace(density=law.density / np.linalg.det(G))
        for name, law in (("tissue", TISSUE), ("wall", WALL))
    }
    one = system_of(case_of(BonedTube(mesh=FLAT), **flat, **{"materials.tissue": TISSUE}))
    other = system_of(case_of(Carrying(mesh=FLAT), **flat, **heavy, **{"conditions.initial_state": "prestress"}))
    X, z = position(), ng.z / one.case.geometry.length
    bent = ng.CF((0.4e-3 * z * z, 0.05 * X[0] * z, 0.1 * X[2] * z + 0.02 * X[1] * z))
    set_motion(one, matrix(G - np.eye(3)) * X + bent)
    one.new_weight.Set(2.0)
    one.velocity_history.components[0].Set(3.0 * X[0] * ng.CF((z, 1.0, 0.3)))
    rng = np.random.default_rng(6)
    for block, size in (("w", 0.02), ("p", 500.0)):
        one.values[one.unknowns.blocks[block]] = size * rng.standard_normal(len(one.unknowns.blocks[block]))
    for system in (one, other):
        value_of(system, "on the skin").Set(700.0)
        system.reference().Set(1300.0)
    # functions of both meshes are the same but for their place
    back = ng.GridFunction(one.unknowns.space.components[0])
    back.Set(matrix(np.eye(3) - G) * X)
    shift = np.zeros(one.unknowns.size)
    shift[: back.space.ndof] = back.vec.FV().NumPy()
    assert other.relaxation is not None
    other.relaxation.vec.data = back.vec
    other.values[:] = one.values + shift
    other.new_weight.Set(2.0)
    other.velocity_history.vec.FV().NumPy()[:] = one.velocity_history.vec.FV().NumPy() - 2.0 * shift
    return one, other


def test_all_columns(pair: tuple[System, System]) -> None:
    """But displacement and det F, which are those from the reference shape."""
    expected, found = (row(refreshed(system)) for system in pair)
    assert expected["displacement_max_m"] > 2 * found["displacement_max_m"]
    for column in expected.keys() - OF_THE_REFERENCE:
        assert found[column] == pytest.approx(expected[column], rel=1e-9, abs=1e-14), column
    assert abs(expected["p_wall_mean_Pa"]) > 1e3


def refreshed(system: System) -> Probe:
    probe = Probe(system)
    probe.refresh()
    return probe


def test_stresses_and_stretches(pair: tuple[System, System]) -> None:
    """The tensors that are stored."""
    for name in (STRESS, DEFORMATION):
        expected, found = (
            np.array([volume_fields(system)[name](system.domain.mesh(*place)) for place in at])
            for system, at in zip(pair, (AT, AT @ G.T), strict=True)
        )
        assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max(), name
    # of which the second is the product of both deformations
    assert np.linalg.norm(found[0].reshape(3, 3) - G) < 0.2


def test_ellipticity(pair: tuple[System, System], monkeypatch: pytest.MonkeyPatch) -> None:
    """It is looked at with the stretches from the shape without stress."""
    seen: list[NDArray[np.float64]] = []

    def noted(_self: Ellipticity, stretches: NDArray[np.float64]) -> NDArray[np.float64]:
        seen.append(stretches)
        return np.ones(len(stretches))

    monkeypatch.setattr(Ellipticity, "smallest", noted)
    for region in ("tissue", "wall"):
        for system in pair:
            assert Deformation(system).unstable(region) == ""
        expected, found = seen[-2:]
        assert found == pytest.approx(expected, rel=1e-9)
        assert expected.min() < 0.98


def test_energy(pair: tuple[System, System]) -> None:
    expected, found = ((energy.stored(), energy.kinetic()) for energy in map(Energy, pair))
    assert found == pytest.approx(expected, rel=1e-9)


def test_stability(pair: tuple[System, System]) -> None:
    """With the pressure at which it is lost."""
    found = []
    for system in pair:
        stability = Stability(system)
        stability.refresh()
        value_of(system, "on the skin").Set(800.0)
        found.append(stability.refresh())
        value_of(system, "on the skin").Set(700.0)
    one, other = found
    assert one.eigenvalue > 0
    for name in ("eigenvalue", "critical", "wall_share"):
        assert getattr(other, name) == pytest.approx(getattr(one, name), rel=1e-5), name


@pytest.mark.usefixtures("pair")
def test_deformation_that_laws_with_memory_follow() -> None:
    expected, found = (place.F(place.mesh(*at)) for place, at in zip(Noting.places, (AT[0], G @ AT[0]), strict=True))
    assert found == pytest.approx(expected, rel=1e-9)
