"""A run on meshes that are refined where the error estimate says: `ngfsi run --refine`.

The difference of a run and its companion of another order (see estimate.py), of the same mesh, is measured in each
element at the end: in solids that of the displacement's gradient, weighted by the shear modulus, in blood that of the
velocity's gradient, each over the norm of the whole. The parts of the mesh (elements, or layers, as the geometry has
it) with the largest shares, which have `MARKED` of the sum of squares together, are refined.
"""

from __future__ import annotations

from time import perf_counter
from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array, Mask, Numbers
from ngfsi.case import Case
from ngfsi.errors import CaseError, OutputError
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.geometry import Refinable
from ngfsi.physics.fields import MOTION, VELOCITY
from ngfsi.run.computation import finished
from ngfsi.run.estimate import companion
from ngfsi.solve.initial import Say, silent
from ngfsi.store.folder import CASE
from ngfsi.store.stored import StoredRun
from ngfsi.system.system import System

MARKED = 0.5
"""Share of the sum of squares in the parts that are refined, as in W. Doerfler, SIAM J Numer Anal 33, 1996."""
EQUAL = 0.1
"""Parts whose squares differ relatively by less are refined together, so that a mesh stays symmetric."""


def check_refinable(case: Case) -> None:
    """Refuse a case whose mesh cannot be refined.

    Raises:
        CaseError: the geometry does not offer it.
        GeometryError: it does, but not for this mesh.
        MeshError: there is no mesh.
    """
    _parts(case, Domain.build(case.geometry))


def refine(
    found: StoredRun, times: int, *, quiet: bool = False, max_wall: float | None = None, say: Say = silent,
    resumed_by: str = "",
) -> list[StoredRun]:  # fmt: skip
    """Compute a run again on meshes refined so many times, in its folder (refined_1, refined_2 ...), and return these.

    What is there already is taken, or goes on.

    Args:
        max_wall: seconds on the clock within which to stop.
        say: takes a sentence about each refinement.
        resumed_by: the command that goes on.

    Raises:
        CaseError, GeometryError: as of `check_refinable`.
        OutputError: the unknowns at the run's end are not stored, or those of its companion are the same.
        MeshError, SolverError, StoppedError, Interrupted: as of `run`.
    """
    began = perf_counter()
    home = found.path
    runs: list[StoredRun] = []

    def how() -> dict[str, Any]:
        left = None if max_wall is None else max(0.0, max_wall - (perf_counter() - began))
        return {"quiet": quiet, "resumed_by": resumed_by, "max_wall": left}

    for number in range(1, times + 1):
        other = companion(found, "space", **how())
        domain = Domain.build(found.case.geometry)
        parts = _parts(found.case, domain)
        squares = np.bincount(parts, indicators(domain, found, other)).astype(float)
        if not squares.any():
            raise OutputError(
                f"the run in '{found.path}' does not differ from its companion: there is nothing to refine"
            )
        marked = mark(squares)
        folder = home / f"refined_{number}"
        if (folder / CASE).exists():
            case = Case.from_toml(folder / CASE)
        else:
            geometry = found.case.geometry.refined(marked, (home / f"refined_{number}.msh").absolute())
            case = found.case.replace(geometry=geometry)
        say(f"refinement {number}: {np.count_nonzero(marked)} of {len(marked)} parts of the mesh, which have "
            f"{squares[marked].sum() / squares.sum():.0%} of the estimated error")  # fmt: skip
        found = finished(case, folder, **how())
        runs.append(found)
    return runs


def indicators(domain: Domain, found: StoredRun, other: StoredRun) -> Array:
    """Return the square of the difference of two runs at the end, (elements,), relative to that of the first.

    Args:
        domain: mesh of both.
    """
    squares = np.zeros(domain.mesh.ne)
    one, two = (_state(domain, run) for run in (found, other))
    moduli = {name: getattr(found.case.materials.law_of(name), "shear_modulus", None) for name in one.solids}
    weights = {name: modulus or 1.0 for name, modulus in moduli.items()} if all(moduli.values()) else {}
    here, there = one.named(one.state), two.named(two.state)
    for field, regions in ((MOTION, tuple(one.solids)), (VELOCITY, domain.lumens)):
        if regions and field in here:
            scale = domain.mesh.MaterialCF({name: weights.get(name, 1.0) for name in regions}, default=0.0)
            slopes = ng.Grad(here[field]), ng.Grad(here[field]) - ng.Grad(there[field])
            whole, difference = (
                np.asarray(ng.Integrate(scale * ng.InnerProduct(slope, slope) * domain.dx(*regions), domain.mesh,
                                        element_wise=True))
                for slope in slopes
            )  # fmt: skip
            if whole.any():
                squares += difference / whole.sum()
    return squares


def mark(squares: Array) -> Mask:
    """Return the fewest parts that have `MARKED` of the sum together, and those that are equal to the least of them."""
    order = np.argsort(squares)[::-1]
    needed = int(np.searchsorted(np.cumsum(squares[order]), MARKED * squares.sum())) + 1
    return np.asarray(squares >= (1 - EQUAL) * squares[order[:needed]].min())


def _parts(case: Case, domain: Domain) -> Numbers:
    if not isinstance(case.geometry, Refinable):
        raise CaseError(
            "--refine is for straight veins and calves, whose layers of elements it halves, and for tetrahedra of an "
            f"external_mesh: a {type(case.geometry).__name__} is refined by the sizes in its table `mesh`"
        )
    return case.geometry.parts_to_refine(domain.mesh)


def _state(domain: Domain, run: StoredRun) -> System:
    """Return the system of a run at its end."""
    system = System(run.case, domain)
    system.values[:] = run.end(domain.fingerprint)
    return system
