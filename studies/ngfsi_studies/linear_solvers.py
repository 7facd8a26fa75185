"""Direct solver against GMRES with p-multigrid: iterations, seconds and memory of one solve on the calf.

    python -m ngfsi_studies.linear_solvers

Each system is the linearised first step from rest, made in a process of its own. Seconds are of the
processor: renewal is all that is made once per matrix but assembly; memory is that of the whole process. What a step
takes is made of these, with the counts of long runs.
"""

from __future__ import annotations

import multiprocessing
import resource
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from ngfsi_geometry.segment import MeshSettings

from ngfsi.arrays import Array
from ngfsi.case import Case, Materials
from ngfsi.errors import SolverError
from ngfsi.linear import multigrid
from ngfsi.linear.backends import Name, choose_backend
from ngfsi.linear.factorisation import Factorisation
from ngfsi.mesh.domain import Domain
from ngfsi.parallel.stopwatch import Stopwatch
from ngfsi.report.tables import markdown_table
from ngfsi.run.computation import fitting_backend
from ngfsi.solve.initial import initial_state
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.system.schemes import weights
from ngfsi.system.system import System
from ngfsi_studies.compare_tissues import LEVELS, MAIN, case, mesh

TIGHT = 1e-6

ITERATIONS, STEPS_PER_RENEWAL = 7.0, 25.0
"""Of a step of the calf at level `paper`: residuals and solutions, and for how many steps factors serve."""


class Taken(NamedTuple):
    """What one solve took.

    Attributes:
        unknowns: of the system.
        loose, tight: iterations of GMRES to its usual tolerance and to `TIGHT`; 0 with a direct solver.
        residual, assembly: seconds of each.
        renewal: seconds of the factorisation, with all that is made once per matrix but the assembly.
        solve: seconds.
        memory: most in use (bytes).
    """

    unknowns: int
    loose: int
    tight: int
    residual: float
    assembly: float
    renewal: float
    solve: float
    memory: float

    @property
    def step(self) -> float:
        """Seconds of one step of a long run."""
        iteration = self.residual + self.solve
        return ITERATIONS * iteration + (self.assembly + self.renewal) / STEPS_PER_RENEWAL


def at_rest(system: System) -> None:
    """Begin the first step of a system from rest, by backward Euler."""
    zero, step = np.zeros(system.unknowns.size), system.case.time.step
    system.update(step)
    system.set_rates(weights("backward_euler", step, None), (zero, zero), (zero, zero), step)


def factorised(system: System, backend: Name) -> Factorisation:
    """Return the factorised linearisation at the system's state."""
    made = Newton(system, backend).factorisation
    made.renew(system.state.vec)
    return made


def update(system: System, factorisation: Factorisation) -> Array:
    """Return the Newton update at the system's state.

    Raises:
        SolverError: GMRES does not converge.
    """
    residual, result = system.residual(), system.state.vec.CreateVector()
    residual.FV().NumPy()[~system.unknowns.free()] = 0.0
    factorisation.solve(residual, result)
    return np.array(result.FV().NumPy())


def measure(stored: dict[str, Any]) -> Taken:
    """Solve the first step of a stored case with its linear solver; its process must have done nothing else."""
    chosen = Case.from_dict(stored)
    watch = Stopwatch(process_time)
    system = System(chosen, Domain.build(chosen.geometry), watch)
    at_rest(system)
    factorisation = factorised(system, choose_backend(chosen.solver.linear))
    update(system, factorisation)  # the first evaluations find nothing in the caches
    analysed, loose = dict(watch.seconds), factorisation.linear_iterations
    factorisation.renew(system.state.vec)
    update(system, factorisation)
    residual, assembly, renewal, solve = (
        watch.seconds[kind] - analysed[kind] for kind in ("residuals", "assembly", "factorisation", "solves")
    )
    before = factorisation.linear_iterations
    multigrid.TOLERANCE, multigrid.LEFT = TIGHT, 1.0
    with suppress(SolverError):
        update(system, factorisation)
    memory = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    tight = factorisation.linear_iterations - before
    return Taken(system.unknowns.size, loose, tight, residual, assembly, renewal, solve, memory)


def step_seconds(chosen: Case) -> float:
    """Return the seconds of a processor that a step of a case takes, the mean of all, without its state at t = 0,
    measures and output; computed in a new process."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_step_seconds, chosen.to_toml_dict()).result()


def _step_seconds(stored: dict[str, Any]) -> float:
    chosen = Case.from_dict(stored)
    system = System(chosen, Domain.build(chosen.geometry))
    newton = Newton(system, fitting_backend(system)[0], *system.unknowns.to_solve)
    initial_state(system, newton)
    begun = process_time()
    count = sum(1 for _ in TimeLoop(chosen, system, newton).run())
    return (process_time() - begun) / count


def alone(chosen: Case) -> Taken:
    """Measure in a new process."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        taken = pool.submit(measure, chosen.to_toml_dict()).result()
    print(f"{chosen.solver.linear}, {taken.unknowns:,} unknowns: {taken.step:.3g} s a step", file=sys.stderr)
    return taken


def _mesh(far: float, near: float, layers: int, radii: tuple[float, ...] = (0.85, 0.55)) -> MeshSettings:
    return MeshSettings(element="mixed", far_size=far, vein_size=near, axial_layers=layers, lumen_radii=radii)


USUAL = _mesh(25e-3, 3.2e-3, 6)
FINER = _mesh(20e-3, 2.8e-3, 7, (0.92, 0.78, 0.5))
COARSEST = _mesh(30e-3, 5e-3, 3, (0.6,))
"""For what refinement does not matter to."""


def _calf(order: int = 2, elements: MeshSettings = USUAL, step: float = 0.01) -> Case:
    settings = elements.replace(curving_order=order)
    return case(MAIN[0], LEVELS["demo"]._replace(mesh=settings, order=order, step=step))


def _elastic(poisson: float) -> Case:
    """Return the calf with Neo-Hookean tissue of one shear modulus."""
    tissue = {"law": "compressible_neo_hookean", "young_kPa": 14 * (1 + poisson), "poisson": poisson,
              "density_kg_m3": 1060}  # fmt: skip
    given = {"tissue": tissue, "wall": {"set": "vein_wall_source"}, "fluid": {"set": "blood"}}
    chosen = _calf(elements=COARSEST).model_copy(update={"materials": Materials.from_dict(given)})
    return chosen.replace(**{"discretisation.bulk_integration": "reduced" if poisson >= 0.49 else "full"})


ROBUSTNESS: dict[str, Case] = {
    "tissue of 25 mm": _calf(),
    "tissue of 20 mm": _calf(elements=FINER),
    "tissue of 14 mm": _calf(elements=_mesh(14e-3, 2e-3, 9, (0.94, 0.85, 0.7, 0.45))),
    "tissue of 9 mm": _calf(elements=_mesh(9e-3, 3.2e-3, 12)),
    **{f"coarsest mesh, order {order}": _calf(order, COARSEST) for order in (2, 3, 4)},
    "step of 100 ms": _calf(elements=COARSEST, step=0.1),
    "step of 1 ms": _calf(elements=COARSEST, step=1e-3),
    "step of 0.1 ms": _calf(elements=COARSEST, step=1e-4),
    **{f"Poisson ratio {poisson:g}": _elastic(poisson) for poisson in (0.3, 0.45, 0.49, 0.499, 0.4999)},
}
SIZES: dict[int, tuple[float, ...]] = {2: (1.0, 0.75, 0.6, 0.5, 0.42), 3: (2.0, 1.5, 1.0, 0.75)}
"""By order: sizes of elements, as in `compare_tissues.mesh`, from 20,000 unknowns on."""


def robustness() -> Iterable[tuple[str, ...]]:
    """Yield the rows of the table of iterations."""
    for name, chosen in ROBUSTNESS.items():
        taken = alone(chosen.replace(**{"solver.linear": "p_multigrid"}))
        most = multigrid.MOST_ITERATIONS
        yield (name, f"{taken.unknowns:,}", str(taken.loose), str(taken.tight) if taken.tight < most else f"> {most}")


def sizes() -> Iterable[tuple[str, ...]]:
    """Yield the rows of the table of seconds and memory, and after each order how a step grows with the unknowns."""
    solvers: tuple[Name, ...] = (choose_backend("auto"), "p_multigrid")
    for order, chosen in SIZES.items():
        taken = {
            solver: [alone(_calf(order, mesh(size, order)).replace(**{"solver.linear": solver})) for size in chosen]
            for solver in solvers
        }
        for solver, rows in taken.items():
            for size, one in zip(chosen, rows, strict=True):
                numbers = (one.residual, one.assembly, one.renewal, one.solve, one.step, one.memory / 1e9)
                yield (f"order {order}, size {size:g}", f"{one.unknowns:,}", solver, *(f"{n:.3g}" for n in numbers))
            yield (f"order {order}, exponent", "", solver, *(f"{growth(rows, name):.2f}" for name in COSTS))


COSTS = ("residual", "assembly", "renewal", "solve", "step", "memory")


def growth(rows: Sequence[Taken], name: str) -> float:
    """Return the power of the number of unknowns with which a cost grows, a least squares fit."""
    logs = np.log([(one.unknowns, getattr(one, name)) for one in rows])
    return float(np.polyfit(logs[:, 0], logs[:, 1], 1)[0])


def main() -> None:
    """Compute all and print the tables, or that of one name."""
    chosen = sys.argv[1:] or ("robustness", "sizes")
    if "robustness" in chosen:
        print(markdown_table(("system", "unknowns", "as used", "to 1e-6"), list(robustness())))
    if "sizes" in chosen:
        heads = ("residual (s)", "assembly (s)", "renewal (s)", "solve (s)", "a step (s)", "memory (GB)")
        print(markdown_table(("calf", "unknowns", "solver", *heads), list(sizes())))


if __name__ == "__main__":
    main()
