"""A run with its states, and the adjoint of its discrete equations backwards through them.

At each time R(y, h, a; p) = 0 with the histories h and a of the rates r = w y + h and w r + a: sums of earlier states,
rates and accelerations by the scheme's weights. The multipliers of a time solve

    (dR/dy)^T z = dQ/dy + what later times owe to y,

and by the histories, -(dR/dh)^T z and -(dR/da)^T z, earlier times owe theirs. What solids remember is a function of
the last accepted state and of what they remembered before, and so is what later times owe to it. The factors are those
of the run, transposed, and renewed when they are too old; an iteration on the exact product, which NGSolve
differentiates (see `lagrangian`), makes up for their age, and for what the tangent of the run leaves out.

dR/dp is a central difference of the residual, of two systems whose case differs in p alone, at the states of the run.
It costs no solution, is right to 1e-8, and needs nothing of a law or a condition: neither code nor a parameter of
NGSolve's in place of a number, of which there would be one form each as well. Only terms that may differ are evaluated.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array
from ngfsi.case import Case
from ngfsi.errors import CaseError, SolverError
from ngfsi.gradient.functionals import Measured, measured
from ngfsi.gradient.lagrangian import Lagrangian, Residual, Uncondensed
from ngfsi.gradient.parameters import Parameter
from ngfsi.gradient.vectors import Vectors
from ngfsi.gradient.window import Window
from ngfsi.linear.backends import BACKENDS, choose_backend
from ngfsi.linear.factorisation import Factorisation
from ngfsi.measure.deformation import Deformation
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.generate import quiet
from ngfsi.physics.integrals import Integral
from ngfsi.solve.initial import Say, initial_state, relaxation_form, silent
from ngfsi.solve.newton import WEIGHT_DRIFT, Newton
from ngfsi.solve.time_loop import Solved, TimeLoop
from ngfsi.system.schemes import Weights
from ngfsi.system.system import BEFORE, System

TOLERANCE, OF_SOLIDS = 1e-9, 1e-12
"""Of Newton's method at most, with blood, whose pressure rounds its velocity, and without: the gradient is of states
that satisfy their equations, and stages of higher order add up what is left."""
EXACT, ENOUGH = 1e-7, 1e-6
"""Relative residual of the adjoint equations that is aimed at, that of the numbers printed, and that is accepted where
rounding hinders more."""
SLOW, PATIENCE = 10, 16
"""Iterations beyond which the next moment has new factors, and after which this one has."""
MOST = 200
"""Iterations at most."""
STAGNATES = 0.1
"""Fraction of the residual that an iteration takes away at least, or an accepted one is left at that."""
AGREEMENT = 1e-4
"""Relative difference beyond which derivatives and differences of the residual are not the same."""
UNEVEN = 0.1
"""Part of the movement of vertices by which it may differ for a larger and a smaller number."""
PROBE = 1e-5
"""Size of the change of the state by which they are compared, over the scales of its unknowns."""

Remembered = dict[str, Array]
"""What solids remember, by its name in snapshots of a system."""
Owed = defaultdict[int, Array]
"""Number of a moment -> derivatives of what follows by its state, its rate and its acceleration."""
OwedMemory = defaultdict[int, Remembered]
"""Number of a moment -> derivatives of what follows by what solids remember of it, and by its state from then on."""


@dataclass(frozen=True)
class Moment(Solved):
    """What was solved, one of all in a run: `earlier` has their numbers in the run; `step` is infinite at rest.

    Attributes:
        histories: of velocity and acceleration, without the new state's part.
        accepted: whether the state is one of the run, which is measured.
        start: number of the accepted moment with which its step began; None: it is the first of all.
    """

    histories: tuple[Array, Array]
    accepted: bool
    start: int | None

    @property
    def rate(self) -> Array:
        """The rates of all unknowns."""
        return self.new * self.state + self.histories[0]

    @property
    def acceleration(self) -> Array:
        """The rates of the rates."""
        return self.new * self.rate + self.histories[1]


@dataclass(frozen=True)
class Slopes:
    """The derivatives of a number by the present state, by the histories and by what solids remember."""

    state: Array | float
    velocity: Array | float
    acceleration: Array | float
    memory: Remembered


@dataclass
class Gradient:
    """What a gradient is and took.

    Attributes:
        name: of the quantity and what is made of it.
        value: of that, SI, with its `unit`.
        derivatives: by the name of the parameter, SI over SI.
        parameters: with their values.
        seconds: of the run, of the adjoint and of the parameters.
        mean_iterations: for each of the states, whose number is `moments`.
        stored_mb: of the states, in memory and on disk.
        own_steps: whether the run has chosen its steps, which are held.
    """

    name: str
    unit: str
    value: float
    parameters: list[Parameter]
    derivatives: dict[str, float]
    seconds: dict[str, float] = field(default_factory=dict)
    mean_iterations: float = 0.0
    factorisations: int = 0
    moments: int = 0
    stored_mb: tuple[float, float] = 0.0, 0.0
    own_steps: bool = False

    def elasticities(self) -> dict[str, float]:
        """Return the change of the quantity in percent for one percent of each parameter, largest first."""
        found = {one.name: self.derivatives[one.name] * one.value / self.value for one in self.parameters}
        return dict(sorted(found.items(), key=lambda item: -abs(item[1])))


def check_supported(case: Case) -> None:
    """Refuse what the adjoint does not know.

    Raises:
        CaseError: says what, and what to do.
    """
    if case.conditions.coupling == "one_way":
        raise CaseError('a gradient is of the whole coupled system: use conditions.coupling = "two_way"')


class StoredStates:
    """A run whose states are kept.

    Attributes:
        vectors: three for each moment, state and histories.
    """

    def __init__(
        self, case: Case, domain: Domain, say: Say = silent, quantities: Sequence[str] = (),
        folder: Path | None = None,
    ) -> None:  # fmt: skip
        """Compute the run.

        Args:
            quantities: that are looked for first, and with whose derivatives the gradients begin.
            folder: for states that are too many for the memory (`vectors.IN_MEMORY`); None: it holds all.

        Raises:
            CaseError: a gradient does not know something in the case.
            OutputError: the folder cannot be written.
            SolverError: the run fails.
        """
        self.vectors = Vectors(folder)
        check_supported(case)
        most = TOLERANCE if domain.lumens else OF_SOLIDS
        tight = case.replace(**{"solver.tolerance": min(case.solver.tolerance, most)})
        self.case, self.domain = tight, domain
        self.system = system = Uncondensed(tight, domain)
        self.measured = {name: measured(system, name) for name in quantities}
        linear = choose_backend(case.solver.linear)
        if BACKENDS[linear].iterates:
            raise CaseError(f"a gradient needs factors to transpose: solver.linear = '{linear}' iterates, use 'auto'")
        newton = Newton(system, linear, *system.unknowns.to_solve)
        initial_state(system, newton, say)
        self.free, self.factors = newton.free, newton.factorisation
        self.relaxation = None if system.relaxation is None else np.array(system.relaxation.vec.FV().NumPy())
        system.prescribe()
        zero, kept = np.zeros(system.unknowns.size), self.vectors.kept
        start = kept(np.array([system.values, zero, zero]))
        self.moments = [Moment(0.0, np.inf, 0.0, start[0], {}, (start[1], start[2]), accepted=True, start=None)]
        self._first_memory, self._memories = self._remembered(), dict[int, Remembered]()
        for _ in TimeLoop(tight, system, newton, Deformation(system).inversion, say, keep=self._keep).run():
            pass

    def _remembered(self) -> Remembered:
        """Return what solids remember."""
        return {f"model {name}.{key}": self.vectors.kept(array) for name, model in self.system.solids.items()
                for key, array in model.state_arrays().items()}  # fmt: skip

    def _keep(self, step: Sequence[Solved]) -> None:
        """Keep what was solved in a step, and what solids remember since its start."""
        last = len(self.moments) - 1
        self._memories[last] = self._remembered()
        for one in step:
            self._add(one, last, accepted=one is step[-1])

    def _add(self, solved: Solved, last: int, *, accepted: bool) -> None:
        """Add what was solved after the accepted state `last`."""
        earlier = {last + number: weights for number, weights in solved.earlier.items() if any(weights)}
        velocity, acceleration = np.zeros((2, self.system.unknowns.size))
        for number, (of_state, of_rate) in earlier.items():
            moment = self.moments[number]
            velocity += of_state * moment.state + of_rate * moment.rate
            acceleration += of_state * moment.rate
            if of_rate:
                acceleration += of_rate * moment.acceleration
        state, *histories = self.vectors.kept(np.array([solved.state, velocity, acceleration]))
        self.moments.append(
            Moment(solved.time, solved.step, solved.new, state, earlier, (histories[0], histories[1]), accepted, last)
        )

    @property
    def accepted(self) -> list[int]:
        """Numbers of the moments that are accepted states."""
        return [number for number, moment in enumerate(self.moments) if moment.accepted]

    @property
    def times(self) -> Array:
        """Of the accepted states (s)."""
        return np.array([self.moments[number].time for number in self.accepted])

    def values(self) -> dict[str, Array]:
        """Return each quantity at the accepted states (SI), one number each, or the parts of which one is made."""
        found: dict[str, list[Any]] = {name: [] for name in self.measured}
        for number in self.accepted:
            self.show(number)
            for name, one in self.measured.items():
                found[name].append(one.record())
        return {name: np.array(values) for name, values in found.items()}

    def show(self, number: int, system: System | None = None) -> None:
        """Let a system hold a moment: that of the run, or one of a case with other constants, with its own loads."""
        system, moment = system or self.system, self.moments[number]
        velocity, acceleration = moment.histories
        system.update(moment.time)
        system.set_rates(Weights(moment.new, 1.0, 0.0), (velocity, velocity), (acceleration, acceleration), moment.step)
        system.values[:] = moment.state
        if system.relaxation is not None:
            system.relaxation.vec.FV().NumPy()[:] = self.relaxation
        system.remember(self.memory(number), self.before(number))
        system.prescribe()

    def memory(self, number: int) -> Remembered:
        """Return what solids remember when a moment is solved for."""
        start = self.moments[number].start
        return self._first_memory if start is None else self._memories[start]

    def before(self, number: int) -> Array | float:
        """Return the state that is the last accepted one when a moment is solved for."""
        start = self.moments[number].start
        return 0.0 if start is None else self.moments[start].state


class Varied:
    """Two systems in whose cases a parameter is larger and smaller."""

    def __init__(self, parameter: Parameter, run: StoredStates) -> None:
        self.parameter, self._run = parameter, run
        self._pair = [self._system(case) for case in parameter.varied(run.case)]
        path, self._measured = parameter.path, dict[str, list[Measured]]()
        if path[0] == "geometry":
            middle = same_mesh(run.case, run.domain, parameter.name)
            check_even([one.domain.vertices for one in self._pair], middle.vertices, parameter.name)
        # of materials the viscosity of the blood is in what is measured
        self._counts = path[0] != "materials" or (path[1] == "fluid" and path[-1] != "density")
        if self._counts and path[0] in ("materials", "geometry"):
            self._measured = {name: [measured(system, name) for system in self._pair] for name in run.measured}

    def _system(self, case: Case) -> System:
        domain, first = self._run.domain, self.parameter.path[0]
        if first == "geometry":
            return Residual(case, same_mesh(case, domain, self.parameter.name))
        if first == "materials":
            return Residual(case, domain, elements=_elements_of(self.parameter.path[1], case, domain))
        return Acting(case, domain)

    def slopes(self, number: int, multipliers: Array, owed: Array, memory: Remembered) -> float:
        """Return what a moment contributes to the derivative by the parameter, but for the quantity itself.

        Args:
            multipliers: of the equations.
            owed: derivative by the unknowns, of which those that are prescribed count.
            memory: derivative by what solids remember from now on.
        """
        products, prescribed = [], ~self._run.free
        for system in self._pair:
            self._run.show(number, system)
            product = owed[prescribed] @ system.values[prescribed]
            system.values[:] = self._run.moments[number].state
            product -= multipliers @ system.unknowns.arranged(system.apply())
            if memory and not isinstance(system, Acting):
                product += sum(memory[name] @ values for name, values in system.new_memory().items() if name in memory)
            products.append(product)
        return float(products[0] - products[1]) / (2 * self.parameter.step)

    def measured_slope(self, number: int, name: str) -> float:
        """Return the derivative of a quantity at a moment, whose state is held."""
        if not self._counts:
            return 0.0
        values = []
        for place, system in enumerate(self._pair):
            self._run.show(number, system)
            system.values[:] = self._run.moments[number].state
            own = self._measured.get(name)
            values.append(own[place].record() if own else self._run.measured[name].under(system))
        return self._run.measured[name].weighed(values[0] - values[1]) / (2 * self.parameter.step)


class Acting(Residual):
    """A system of which only the terms of the conditions are evaluated: those that may differ with loads."""

    def integrals(self, *, linearised: bool = False) -> list[Integral]:  # noqa: ARG002 - there is no tangent
        return [one for condition in self.conditions.values() for one in condition.integrals(self._elements)]

    def inertia_integrals(self, _acceleration: Any, _v: Any) -> list[Integral]:
        return []


def _elements_of(region_kind: str, case: Case, domain: Domain) -> ng.BitArray:
    """Return the elements of the regions whose material stands under a key."""
    material = getattr(case.materials, region_kind)
    fluid = region_kind == "fluid"
    regions = domain.lumens if fluid else [n for n in domain.geometry.solids if case.materials.law_of(n) is material]
    mask = ng.BitArray(domain.mesh.ne)
    mask.Clear()
    for element in domain.materials(*regions).Elements():
        mask.Set(element.nr)
    return mask


def same_mesh(case: Case, domain: Domain, name: str) -> Domain:
    """Return the domain of a case with another geometry, whose elements have the same vertices.

    Mesh files hold curved surfaces to six digits, too few for differences: once it has been made in a process of its
    own, without a crash, it is made here.

    Raises:
        CaseError: they have not.
    """
    other = Domain.build(case.geometry)
    with quiet():
        attempt = list(case.geometry.mesh_attempts()).index(other.report.way)
        other = Domain(ng.Mesh(case.geometry.netgen_mesh(attempt)), case.geometry, other.report)
    one, two = ([tuple(v.nr for v in e.vertices) for e in d.mesh.Elements(ng.VOL)] for d in (domain, other))
    if one != two:
        raise CaseError(f"--by {name}: the mesh is another one when it changes, so that there is no derivative: "
                        "structured geometries such as a tube keep theirs")  # fmt: skip
    return other


def check_even(ends: Sequence[Array], middle: Array, name: str) -> None:
    """Refuse a number of the geometry with which vertices (n, dim) jump, as those of unstructured meshes do.

    Raises:
        CaseError: they do not move as much to one side as to the other.
    """
    if np.abs(ends[0] + ends[1] - 2 * middle).max() > UNEVEN * np.abs(ends[0] - ends[1]).max():
        raise CaseError(f"--by {name}: the vertices of the mesh jump when it changes, so that there is no derivative: "
                        "structured geometries such as a tube move theirs evenly")  # fmt: skip


class Adjoint:
    """The adjoint equations of a run.

    Attributes:
        iterations: of each moment that was solved for.
        seconds: that the parameters took.
    """

    def __init__(self, run: StoredStates, parameters: Sequence[Parameter]) -> None:
        self.run = run
        self.lagrangian = Lagrangian(run.case, run.domain)
        self._free, self._factors = run.free, run.factors
        self._factored = 0.0
        self.iterations: list[int] = []
        self.factorisations = 0
        self._followers: list[tuple[Array, Array]] = []
        self._by_relaxation = np.zeros(run.system.unknowns.size)
        self._random = np.random.default_rng(0)
        self._right, self._result = (run.system.state.vec.CreateVector() for _ in range(2))
        started = perf_counter()
        self._varied = [Varied(one, run) for one in parameters]
        self.seconds = perf_counter() - started

    def derivatives(
        self, weights: Mapping[str, Array], say: Say = silent, seen: Callable[[int, Array], None] | None = None
    ) -> Array:
        """Return the derivatives by the parameters of a number that is made of quantities, by one sweep backwards.

        Args:
            weights: of each quantity, the derivatives of the number by its values at the accepted states. Of a misfit
                they are the weighted gaps: a sweep is the same for one measured value and for all.
            seen: is given the number of each moment and its multipliers.

        Raises:
            CaseError: something acts of which the derivative is not known; says when.
            SolverError: the adjoint equations could not be solved.
        """
        run, found = self.run, np.zeros(len(self._varied))
        slopes: dict[int, dict[str, float]] = defaultdict(dict)
        for name, by_state in weights.items():
            for number, slope in zip(run.accepted, by_state, strict=True):
                if slope:
                    slopes[number][name] = slope
        self._by_relaxation[:] = 0.0
        remembered: OwedMemory = defaultdict(dict)
        # in motion factors of an early state are too old for the last: with weight 0 they count as such
        self._factored = 0.0
        owed: Owed = defaultdict(lambda: np.zeros((3, run.system.unknowns.size)))
        for number in reversed(range(len(run.moments))):
            prestressed = number == 0 and run.relaxation is not None
            memory = {name: part for name, part in remembered[number].items() if name != BEFORE}
            if not (slopes[number] or number in owed or prestressed or any(map(np.any, remembered[number].values()))):
                continue  # nothing measured depends on this state
            run.show(number)
            multipliers, by_state = self._step(number, slopes[number], owed, remembered)
            if seen is not None:
                seen(number, multipliers)
            before = perf_counter()
            for place, one in enumerate(self._varied):
                found[place] += one.slopes(number, multipliers, by_state, memory)
                for name, slope in slopes[number].items():
                    found[place] += slope * one.measured_slope(number, name)
            self.seconds += perf_counter() - before
            say(f"t = {run.moments[number].time:.6g} s: {self.iterations[-1]} iterations")
        return found

    def of_state(self, number: int, quantities: Sequence[str]) -> Array:
        """Return the multipliers (quantities, unknowns) of quantities of one moment at rest, with factors of its own.

        Raises:
            CaseError, SolverError: as of `derivatives`.
        """
        self.run.show(number)
        self._renew()
        found = []
        for name in quantities:
            self.run.show(number)
            owed: Owed = defaultdict(lambda: np.zeros((3, self.run.system.unknowns.size)))
            found.append(self._step(number, {name: 1.0}, owed, defaultdict(dict, {number: {}}))[0])
        return np.array(found)

    def _step(
        self, number: int, slopes: Mapping[str, float], owed: Owed, remembered: OwedMemory
    ) -> tuple[Array, Array]:
        """Solve for the multipliers of a moment, and let earlier ones owe theirs; return the multipliers, and the
        derivative of quantity and equations by the unknowns, which is left of those that are prescribed."""
        run, system, lagrangian = self.run, self.run.system, self.lagrangian
        moment = run.moments[number]
        by_state, by_rate, by_acceleration = owed.pop(number, np.zeros((3, run.system.unknowns.size)))
        by_rate = by_rate + moment.new * by_acceleration
        by_state = by_state + moment.new * by_rate
        by_histories = [by_rate, by_acceleration]
        for name, slope in slopes.items():
            state, history = run.measured[name].gradient()
            by_state += slope * state
            by_histories[0] = by_histories[0] + slope * history
        lagrangian.restore(system.snapshot())
        memory = remembered.pop(number)
        by_state += memory.pop(BEFORE, 0.0)
        update = self._of_update(memory)
        by_state += update.state
        by_histories = [by_histories[0] + update.velocity, by_histories[1] + update.acceleration]
        self._find_followers()
        if number == 0 and run.relaxation is not None:
            multipliers = self._of_prestress(by_state)
            derivative = self._derivative(multipliers)
        else:
            multipliers, derivative = self._solve(self._pulled_back(by_state))
        lagrangian.set_multipliers(multipliers)
        by_relaxation = lagrangian.by_relaxation()
        if by_relaxation is not None:
            self._by_relaxation -= by_relaxation
        products = lagrangian.by_histories()
        residual = Slopes(derivative, *products, lagrangian.by_memory())
        if moment.start is not None:
            for name, product in residual.memory.items():
                part = update.memory.get(name, 0.0) - product
                remembered[moment.start][name] = remembered[moment.start].get(name, 0.0) + part
        self._check(number, multipliers, memory, residual, update)
        for earlier, (of_state, of_rate) in moment.earlier.items():
            for order, (by_history, product) in enumerate(zip(by_histories, products, strict=True)):
                owed[earlier][order] += of_state * (by_history - product)
                owed[earlier][order + 1] += of_rate * (by_history - product)
        return multipliers, by_state - derivative

    def _of_update(self, memory: Remembered) -> Slopes:
        """Return the derivatives of what solids remember from now on, times those by it; what follows from the shape
        free of stress is added to its own."""
        if not memory:
            return Slopes(0.0, 0.0, 0.0, {})
        self.lagrangian.set_owed(memory)
        if (by_relaxation := self.lagrangian.update_by_relaxation()) is not None:
            self._by_relaxation += by_relaxation
        return Slopes(*self.lagrangian.update_by_state(), self.lagrangian.update_by_memory())

    def _pulled_back(self, by_all: Array) -> Array:
        """Return a derivative by all unknowns as one by the free ones, on which those that are prescribed depend."""
        found = by_all.copy()
        for condition in self.run.system.conditions.values():
            numbers = condition.prescribed()
            if len(numbers):
                factors = np.zeros(len(by_all))
                factors[numbers] = by_all[numbers]
                if (part := condition.pull_back(factors)) is not None:
                    found += part
        found[~self._free] = 0.0
        return found

    def _of_prestress(self, by_state: Array) -> Array:
        """Return the multipliers of a start in the given shape: in place of the motion, that does not take part, there
        is the displacement to the shape that is free of stress, on which all moments depend."""
        system, backend = self.run.system, self.run.factors.backend
        space = system.unknowns.space.components[0]
        solids = system.unknowns.free("d")
        form = relaxation_form(system, condense=False)
        factors = Factorisation(form, solids[: space.ndof], backend)
        relaxation, right = ng.GridFunction(space), ng.GridFunction(space)
        relaxation.vec.FV().NumPy()[:] = self.run.relaxation
        factors.renew(relaxation.vec)
        right.vec.FV().NumPy()[:] = self._by_relaxation[: space.ndof]
        factors.solve_transposed(right.vec, relaxation.vec)
        found = np.zeros_like(by_state)
        found[: space.ndof] = relaxation.vec.FV().NumPy()
        flow = [name for name, part in system.unknowns.blocks.items() if len(part) and name not in "de"]
        if not flow:
            self.iterations.append(0)
            return found
        by_state = by_state - self._derivative(found)
        others = self._free, self._factors, self._factored
        self._free, unknowns = system.unknowns.free(*flow), system.unknowns
        self._factors = Factorisation(system.tangent, self._free, backend, unknowns.equations, less=unknowns.less)
        self._renew()
        found += self._solve(np.where(self._free, by_state, 0.0))[0]
        self._free, self._factors, self._factored = others  # of a further sweep
        return found

    def _solve(self, right: Array) -> tuple[Array, Array]:
        """Return the multipliers z for which the transposed linearisation times z is a vector, zero on fixed unknowns,
        and their derivative by all unknowns.

        By generalised conjugate residuals, which are GMRES with the products at hand (S. Eisenstat, H. Elman and M.
        Schultz, SIAM J Numer Anal 20, 1983), in the scale of each unknown, with the factors of an earlier state.

        Raises:
            SolverError: it does not converge.
        """
        scale, count = self._scales(), 0
        found, derivative, left = np.zeros_like(right), np.zeros_like(right), right * scale
        wanted = EXACT * float(np.linalg.norm(left))
        if not np.isfinite(wanted):
            raise SolverError("a measured quantity has a derivative that is not finite")
        if self._is_old():
            self._renew()
        ways = np.empty((3, PATIENCE, len(right)))  # with their images and whole images
        fall = 1.0
        while (norm := float(np.linalg.norm(left))) > wanted:
            rounding = norm < ENOUGH / EXACT * wanted and fall < STAGNATES
            if rounding or count == MOST:
                break
            way = self._preconditioned(left / scale)
            whole = self._derivative(way)
            product = self._pulled_back(whole) * scale
            new = np.array([way, product, whole])
            for _ in range(2):  # once leaves rounding
                new -= np.tensordot(ways[1, :count] @ new[1], ways[:, :count], axes=(0, 1))
            new /= np.linalg.norm(new[1])
            if count == ways.shape[1]:
                ways = np.concatenate([ways, np.empty_like(ways)], axis=1)
            ways[:, count] = new
            step = new[1] @ left
            found += step * new[0]
            derivative += step * new[2]
            left = left - step * new[1]
            fall = 1 - float(np.linalg.norm(left)) / norm
            count += 1
            if count == PATIENCE:
                self._renew()
        self.iterations.append(count)
        if norm > ENOUGH / EXACT * wanted:
            size = EXACT * norm / wanted
            raise SolverError(f"the adjoint equations were solved to {size:.1e} only, in {count} iterations")
        return found, derivative

    def _is_old(self) -> bool:
        """Whether the factors are too far from the present state."""
        weight = self.run.system.new_weight.Get()
        ratio = max(weight, self._factored) > WEIGHT_DRIFT * min(weight, self._factored)
        return ratio or bool(self.iterations and self.iterations[-1] > SLOW)

    def _renew(self) -> None:
        self._factors.renew(self.run.system.state.vec)
        self._factored = self.run.system.new_weight.Get()
        self.factorisations += 1

    def _preconditioned(self, values: Array) -> Array:
        self._right.FV().NumPy()[:] = values
        self._factors.solve_transposed(self._right, self._result)
        return np.array(self._result.FV().NumPy())

    def _scales(self) -> Array:
        system = self.run.system
        scales, found = system.block_scales(), np.ones(system.unknowns.size)
        for name, part in system.unknowns.blocks.items():
            if len(part):
                found[part] = scales[name]
        return found

    def _find_followers(self) -> None:
        """Find how the residual depends on numbers that follow the present state, on which it depends linearly."""
        system, self._followers = self.run.system, []
        for condition in system.conditions.values():
            for parameter, slopes in condition.followers():
                present, found = parameter.Get(), []
                for factor in (1.0, 0.0):
                    parameter.Set(factor * present)
                    found.append(system.unknowns.arranged(system.apply()))
                parameter.Set(present)
                self._followers.append(((found[0] - found[1]) / present, slopes))

    def _derivative(self, multipliers: Array) -> Array:
        """Return the derivative of multipliers times residual by all unknowns."""
        self.lagrangian.set_multipliers(multipliers)
        found = self.lagrangian.by_state()
        for by_number, slopes in self._followers:
            found += (multipliers @ by_number) * slopes
        return found

    def _check(self, number: int, multipliers: Array, memory: Remembered, residual: Slopes, update: Slopes) -> None:
        """Compare the derivatives with differences of the residual and of what solids remember, of a random change of
        all that they depend on.

        Raises:
            CaseError: they differ: something in the case depends on the state in a way of its own.
        """
        system, run, moment = self.run.system, self.run, self.run.moments[number]
        change = PROBE * self._scales() * self._random.standard_normal(len(run.free)) * run.free
        rate, kept = moment.new, run.memory(number)
        changes = {name: PROBE * np.abs(values).max(initial=0.0) * self._random.standard_normal(values.shape)
                   for name, values in kept.items()}  # fmt: skip
        parts = [self._pulled_back(np.asarray(residual.state - update.state)) * change,
                 (residual.velocity - update.velocity) * rate * change,
                 (residual.acceleration - update.acceleration) * rate**2 * change,
                 *((by_memory - update.memory.get(name, 0.0)) * changes.get(name, change)
                   for name, by_memory in residual.memory.items())]  # fmt: skip
        expected, size = sum(part.sum() for part in parts), sum(float(np.linalg.norm(part)) for part in parts)
        products = []
        for sign in (1, -1):
            run.show(number)
            system.values[:] += sign * change
            system.velocity_history.vec.FV().NumPy()[:] += sign * rate * change
            system.acceleration_history.vec.FV().NumPy()[:] += sign * rate**2 * change
            system.remember({name: values + sign * changes[name] for name, values in kept.items()},
                            run.before(number) + sign * change)  # fmt: skip
            product = multipliers @ np.asarray(system.residual().FV().NumPy())
            if memory:
                product -= sum(memory[name] @ values for name, values in system.new_memory().items() if name in memory)
            products.append(product)
        run.show(number)
        difference = (products[0] - products[1]) / 2
        if abs(difference - expected) > AGREEMENT * size:
            raise CaseError(
                f"at t = {moment.time:g} s something depends on the state in a way that a gradient does not know: "
                f"its derivative is {expected:.6g} and differences of the residual are {difference:.6g}"
            )


def gradient_of(
    case: Case, quantity: str, window: Window, parameters: Sequence[Parameter], say: Say = silent,
    domain: Domain | None = None, folder: Path | None = None,
) -> Gradient:  # fmt: skip
    """Return the gradient of a quantity of a run by parameters of its case.

    Args:
        domain: of the case; default: it is made.
        folder: as of `StoredStates`.

    Raises:
        CaseError: what is asked for is not there, or not known to gradients.
        MeshError, SolverError: as for a run.
    """
    check_supported(case)
    domain = domain or Domain.build(case.geometry)
    with ng.TaskManager():
        started = perf_counter()
        run = StoredStates(case, domain, say, [quantity], folder)
        ran = perf_counter()
        value, weights = run.measured[quantity].made(window, run.times, run.values()[quantity])
        adjoint = Adjoint(run, parameters)
        derivatives = adjoint.derivatives({quantity: weights}, say)
        swept = perf_counter() - ran - adjoint.seconds
    return Gradient(
        quantity if window.kind == "end" else f"{quantity}_{window.kind}",
        run.measured[quantity].unit if window.kind != "loss" else "1", value, list(parameters),
        dict(zip((one.name for one in parameters), derivatives.tolist(), strict=True)),
        {"run": ran - started, "adjoint": swept, "parameters": adjoint.seconds},
        float(np.mean(adjoint.iterations)), adjoint.factorisations, len(run.moments),
        (run.vectors.in_memory / 1e6, run.vectors.on_disk / 1e6), case.time.error_tolerance is not None,
    )  # fmt: skip
