"""A run on meshes that are refined where the error estimate says: `ngfsi run --refine`.

The difference of a run and its companion of another order (see estimate.py), of the same mesh, is measured in each
element at the end, and weighted with the same difference of the dual solutions of loss of volume and SAWSS: what these
quantities do not feel, as the singular rims of clamped ends far from a vein, is not refined. Weights are left out where
there is no blood, or a linearisation that cannot be transposed. The parts of the mesh (elements, or layers, as the
geometry has it) with the largest shares, which have `MARKED` of the sum together, are refined.
"""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array, Mask, Numbers
from ngfsi.case import Case
from ngfsi.errors import CaseError, OutputError
from ngfsi.gradient.duals import duals, has_duals
from ngfsi.gradient.lagrangian import Uncondensed
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.geometry import Refinable
from ngfsi.physics.fields import MOTION, VELOCITY
from ngfsi.run.computation import finished
from ngfsi.run.estimate import companion
from ngfsi.run.interrupts import time_left
from ngfsi.solve.initial import Say, silent
from ngfsi.store.folder import CASE
from ngfsi.store.stored import StoredRun

MARKED = 0.25
"""Share of the sum in the parts that are refined, as in W. Doerfler, SIAM J Numer Anal 33, 1996."""
EQUAL = 0.1
"""Parts whose shares differ relatively by less are refined together, so that a mesh stays symmetric."""


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
    left, home = time_left(max_wall), found.path
    runs: list[StoredRun] = []

    def how() -> dict[str, Any]:
        return {"quiet": quiet, "resumed_by": resumed_by, "max_wall": left()}

    for number in range(1, times + 1):
        other = companion(found, "space", **how())
        domain = Domain.build(found.case.geometry)
        parts = _parts(found.case, domain)
        shares = np.bincount(parts, indicators(domain, found, other)).astype(float)
        if not shares.any():
            raise OutputError(
                f"the run in '{found.path}' does not differ from its companion: there is nothing to refine"
            )
        marked = mark(shares)
        folder = home / f"refined_{number}"
        if (folder / CASE).exists():
            case = Case.from_toml(folder / CASE)
        else:
            geometry = found.case.geometry.refined(marked, (home / f"refined_{number}.msh").absolute())
            case = found.case.replace(geometry=geometry)
        say(f"refinement {number}: {np.count_nonzero(marked)} of {len(marked)} parts of the mesh, which have "
            f"{shares[marked].sum() / shares.sum():.0%} of the estimated error")  # fmt: skip
        found = finished(case, folder, **how())
        runs.append(found)
    return runs


def indicators(domain: Domain, found: StoredRun, other: StoredRun) -> Array:
    """Return each element's share in the error at the end, (elements,), from the difference of two runs.

    With e and e* the differences of the solutions and of the dual solutions of a quantity Q, it is the product of
    |grad e| and |grad e*|, norms of L2 with the shear modulus in solids and the viscosity in blood, over Q; of loss of
    volume and SAWSS together. Without dual solutions it is the square of |grad e|, of displacement and velocity each
    over that of the whole.

    Args:
        domain: mesh of both.
    """
    one, two = (_state(domain, run) for run in (found, other))
    goals = _goals(found) if has_duals(one) else {}
    moduli = {name: getattr(found.case.materials.law_of(name), "shear_modulus", None) for name in one.solids}
    weights = {name: modulus or 1.0 for name, modulus in moduli.items()} if all(moduli.values()) else {}
    fields = {MOTION: tuple(one.solids), VELOCITY: domain.lumens}
    here, there = one.named(one.state), two.named(two.state)

    def squares(field: str, slope: Any) -> Array:
        scales = {name: weights.get(name, 1.0) if field == MOTION else one.viscosity() for name in fields[field]}
        square = domain.mesh.MaterialCF(scales, default=0.0) * ng.InnerProduct(slope, slope)
        return np.asarray(ng.Integrate(square * domain.dx(*fields[field]), domain.mesh, element_wise=True))

    total = np.zeros(domain.mesh.ne)
    present = [field for field, regions in fields.items() if regions and field in here]
    errors = {field: squares(field, ng.Grad(here[field]) - ng.Grad(there[field])) for field in present}
    if not goals:
        wholes = {field: squares(field, ng.Grad(here[field])).sum() for field in present}
        return sum((errors[field] / whole for field, whole in wholes.items() if whole > 0), start=total)
    first, second = duals(one, goals), duals(two, goals)
    for goal, size in goals.items():
        slope = ng.Grad(first[goal].components[0]) - ng.Grad(second[goal].components[0])
        for field in present:  # the balance of momentum is tested with functions of the motion in solids and in blood
            total += np.sqrt(errors[field] * squares(field, slope)) / size
    return total


def _goals(found: StoredRun) -> dict[str, float]:
    """Return the quantities of blood that are to be right -> their size at the end: loss of volume (m3), SAWSS (Pa)."""
    goals: dict[str, float] = {}
    for name in (vessel.name for vessel in found.case.geometry.vessels if vessel.lumen):
        prefix = f"{name}_" if name else ""
        volume = found.series[f"{prefix}lumen_volume_m3"]
        goals |= {f"{prefix}lumen_volume": abs(float(volume[-1] - volume[0])),
                  f"{prefix}sawss": float(found.series[f"{prefix}sawss_Pa"][-1])}  # fmt: skip
    return {name: size for name, size in goals.items() if size > 0}


def mark(shares: Array) -> Mask:
    """Return the fewest parts that have `MARKED` of the sum together, and those that are equal to the least of them."""
    order = np.argsort(shares)[::-1]
    needed = int(np.searchsorted(np.cumsum(shares[order]), MARKED * shares.sum())) + 1
    return np.asarray(shares >= (1 - EQUAL) * shares[order[:needed]].min())


def _parts(case: Case, domain: Domain) -> Numbers:
    if not isinstance(case.geometry, Refinable):
        raise CaseError(
            "--refine is for straight veins and calves, whose layers of elements it halves, and for tetrahedra of an "
            f"external_mesh: a {type(case.geometry).__name__} is refined by the sizes in its table `mesh`"
        )
    return case.geometry.parts_to_refine(domain.mesh)


def _state(domain: Domain, run: StoredRun) -> Uncondensed:
    """Return the system of a run at its end, as if that were a steady state."""
    system = Uncondensed(run.case, domain)
    system.restore(run.end(domain.fingerprint))
    system.set_steady()
    return system
