"""GMRES with p-multigrid: it solves what a direct solver does, in numbers of iterations that hardly change."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from ngfsi_geometry.segment import MeshSettings
from ngfsi_studies.linear_solvers import at_rest, factorised, update
from numpy.typing import NDArray

from ngfsi.case import Case
from ngfsi.errors import SolverError
from ngfsi.linear import multigrid
from ngfsi.linear.backends import Name, choose_backend
from ngfsi.linear.factorisation import Factorisation
from ngfsi.linear.levels import levels_of
from ngfsi.materials import CompressibleNeoHookean
from ngfsi.system.system import System
from ngfsi.system.unknowns import BLOCKS
from tests.vein import BONED, block, case_of, randomise, steady, system_of

Array = NDArray[np.float64]
TIGHT = 1e-9


def mesh(far: float, near: float, layers: int, order: int = 2) -> MeshSettings:
    return MeshSettings(element="mixed", far_size=far, vein_size=near, axial_layers=layers, lumen_radii=(),
                        curving_order=order)  # fmt: skip


def vein(settings: MeshSettings, step: float = 0.01, poisson: float = 0.3, **changes: Any) -> Case:
    tissue = CompressibleNeoHookean(young=30e3, poisson=poisson, density=1060.0)
    geometry = BONED.replace(length=20e-3, mesh=settings)
    case = case_of(geometry, **{"time.step": step, **changes})
    return case.model_copy(update={"materials": case.materials.model_copy(update={"tissue": tissue})})


def first_step(case: Case) -> System:
    """Return the system at the beginning of its first step, from rest."""
    system = system_of(case)
    at_rest(system)
    system.reference().Set(0.0)  # so the pressure of the blood is unknown as a whole
    return system


def solved(system: System, backend: Name) -> tuple[Array, int]:
    """Return one Newton update at the system's state, and the iterations of GMRES that it took."""
    factorisation = factorised(system, backend)
    return update(system, factorisation), factorisation.linear_iterations


@pytest.mark.parametrize("order", [2, 3])
def test_solves_what_a_direct_solver_does(order: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(multigrid, "TOLERANCE", TIGHT)
    system = system_of(case_of(BONED.replace(mesh=mesh(12e-3, 5e-3, 1, order))))
    randomise(system, amplitude=5e-5)
    levels = levels_of(system.domain, system.unknowns)
    smoothed = np.unique(np.concatenate(levels.patches))
    assert np.all(levels.factorised[0] | levels.factorised[1] | np.isin(np.arange(system.unknowns.size), smoothed))
    exact, _ = solved(system, choose_backend("auto"))
    found, iterations = solved(system, "p_multigrid")
    assert iterations > 3
    for row in BLOCKS:
        a, b = block(system, row, exact), block(system, row, found)
        assert np.linalg.norm(a - b) < 1e-4 * np.linalg.norm(a), row


MIDDLE = mesh(6e-3, 4e-3, 3)
COUNTS = {
    "middle": (vein(MIDDLE), 8),
    "coarse": (vein(mesh(10e-3, 5e-3, 2)), 8),
    "fine": (vein(mesh(4e-3, 3e-3, 5)), 8),
    "order 3": (vein(mesh(10e-3, 5e-3, 2, 3)), 10),
    "order 4": (vein(mesh(20e-3, 8e-3, 1, 4)), 11),
    "short step": (vein(MIDDLE, step=1e-4), 8),
    "long step": (vein(MIDDLE, step=0.2), 8),
    "poisson 0.49": (vein(MIDDLE, poisson=0.49), 17),
    "poisson 0.4999": (vein(MIDDLE, poisson=0.4999, **{"discretisation.bulk_integration": "reduced"}), 35),
}
"""Case, and iterations that reduce the error a million times."""


def test_without_iterations_an_update_is_one_sweep(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last correction takes none: it is not nothing, and along the exact update."""
    system = first_step(COUNTS["middle"][0])
    exact, _ = solved(system, choose_backend("auto"))
    monkeypatch.setattr(multigrid, "TOLERANCE", 1.0)
    found, iterations = solved(system, "p_multigrid")
    assert iterations == 0
    one, other = block(system, "d", exact), block(system, "d", found)
    assert one @ other > 0.9 * np.linalg.norm(one) * np.linalg.norm(other)
    assert np.linalg.norm(other) > 0.5 * np.linalg.norm(one)


@pytest.mark.parametrize("name", COUNTS)
def test_iterations(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(multigrid, "TOLERANCE", 1e-6)
    case, most = COUNTS[name]
    _, iterations = solved(first_step(case), "p_multigrid")
    assert iterations <= most


def test_a_run_ends_where_that_with_a_direct_solver_does() -> None:
    """To the tolerance of Newton's method, that of GMRES being 1e-2."""
    small = vein(mesh(10e-3, 5e-3, 1), **{"solver.tolerance": TIGHT})
    (one, _), (other, newton) = (steady(small.replace(**{"solver.linear": name})) for name in ("auto", "p_multigrid"))
    assert newton.factorisation.linear_iterations > 0
    for row in BLOCKS:
        a, b = block(one, row, one.values), block(other, row, other.values)
        assert np.linalg.norm(a - b) < 30 * TIGHT * np.linalg.norm(a), row


def test_errors_are_judged_by_the_scales(monkeypatch: pytest.MonkeyPatch) -> None:
    """To a few 1e-2 of that unknown whose scale is small against its change, and of no other; without scales
    displacement and velocity would be found to 0.5 and 0.8, since the pressure has the largest numbers. Renewed, with
    new scales."""
    system = first_step(vein(mesh(12e-3, 5e-3, 1)))
    exact, _ = solved(system, choose_backend("auto"))
    scales: dict[str, float] = {}
    monkeypatch.setattr(system, "block_scales", lambda: scales)
    made, errors = None, {}
    for wanted in "pwed":
        scales |= dict.fromkeys(BLOCKS, 1e9) | {wanted: 1e-3 * np.abs(block(system, wanted, exact)).max()}
        made = made or factorised(system, "p_multigrid")
        made.renew(system.state.vec)
        found = update(system, made)
        errors[wanted] = [
            np.linalg.norm(block(system, row, found - exact)) / np.linalg.norm(block(system, row, exact))
            for row in (wanted, "d")
        ]
    assert max(one for one, _ in errors.values()) < 6e-2
    assert errors["p"][1] > 0.1


def test_failure_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    system = first_step(COUNTS["coarse"][0])
    monkeypatch.setattr(multigrid, "MOST_ITERATIONS", 1)
    monkeypatch.setattr(multigrid, "TOLERANCE", TIGHT)
    with pytest.raises(SolverError, match="GMRES did not solve"):
        solved(system, "p_multigrid")
    system.values[:] = np.nan
    with pytest.raises(SolverError):
        solved(system, "p_multigrid")


def test_systems_without_levels_are_refused() -> None:
    system = first_step(COUNTS["coarse"][0])
    with pytest.raises(SolverError, match="is for coupled systems: use 'auto'"):
        Factorisation(system.tangent, system.unknowns.free(), "p_multigrid").renew(system.state.vec)
