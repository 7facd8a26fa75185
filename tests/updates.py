"""Newton updates of one system by all ranks together: what tests/test_ranks.py starts under mpirun."""

from __future__ import annotations

from pathlib import Path

import ngsolve as ng
import numpy as np
from ngfsi_geometry.segment import MeshSettings
from ngfsi_studies.linear_solvers import at_rest
from numpy.typing import NDArray

from ngfsi.case import Case
from ngfsi.linear import multigrid
from ngfsi.linear.backends import Name
from ngfsi.linear.factorisation import Factorisation
from ngfsi.linear.levels import levels_of
from ngfsi.parallel.ranks import Ranks
from ngfsi.run.worker import partition
from ngfsi.system.system import System
from tests.vein import BONED, case_of, domain_of, randomise

TIGHT, LOOSE = 1e-6, multigrid.TOLERANCE


def case(order: int) -> Case:
    """Return a vein beside a bone, on a mesh with elements of the tissue inside of each of three shares."""
    mesh = MeshSettings(element="mixed", far_size=8e-3, vein_size=5e-3, axial_layers=2, lumen_radii=(),
                        curving_order=order)  # fmt: skip
    return case_of(BONED.replace(length=20e-3, mesh=mesh), **{"time.step": 0.01, "discretisation.order": order})


def updates(order: int, backend: Name, ranks: Ranks) -> tuple[NDArray[np.float64], list[int]]:
    """Return the updates at rest, there again with a loose tolerance that counts for displacements alone, and in a
    lively flow and a step of 0.1 ms, each with the factors renewed, and the iterations of each."""
    chosen = case(order)
    domain = domain_of(chosen.geometry)
    mine = ng.BitArray(list(partition(domain, ranks.size) == ranks.rank))
    system = System(chosen, domain, ranks=ranks, elements=mine)
    unknowns, scale = system.unknowns, np.ones(system.unknowns.size)
    made = Factorisation(system.tangent, unknowns.free(), backend, unknowns.equations, scale=lambda: scale,
                         levels=lambda: levels_of(domain, unknowns), ranks=ranks)  # fmt: skip
    rows = system.distribution(np.ones(unknowns.size, dtype=bool))
    found, counts = [], [0]
    for prepare, tolerance, weight in ((at_rest, TIGHT, 1.0), (at_rest, LOOSE, 1e9), (_in_flow, TIGHT, 1.0)):
        prepare(system)
        multigrid.TOLERANCE = tolerance
        for name, value in system.block_scales().items():
            scale[unknowns.blocks[name]] = value if name == "d" else weight * value
        made.renew(system.state.vec)
        right, update = system.state.vec.CreateVector(), system.state.vec.CreateVector()
        right.FV().NumPy()[:] = np.where(unknowns.free(), system.apply()[unknowns.equations], 0.0)
        made.solve(right, update)
        found.append(rows.whole(np.asarray(update.FV().NumPy())[rows.mine]))
        counts.append(made.linear_iterations)
    multigrid.TOLERANCE = LOOSE
    return np.array(found), list(np.diff(counts))


def _in_flow(system: System) -> None:
    system.update(0.0)
    randomise(system, amplitude=1e-5)
    system.new_weight.Set(1e4)


def store(file: Path | str, order: int, ranks: Ranks) -> None:
    """Write what fieldsplit finds, on rank 0."""
    found, counts = updates(order, "fieldsplit", ranks)
    if ranks.leads:
        np.savez(file, updates=found, iterations=counts)
