"""The weak form with given test functions, and its derivatives by all that it depends on.

With multipliers in place of the test functions the weak form is one number, whose derivatives by the state and by the
histories of the rates are the products of the transposed matrices with the multipliers. NGSolve differentiates the
integrands that are there: laws and conditions have no code for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import GridFunction

from ngfsi.arrays import Array
from ngfsi.conditions.condition import Setup
from ngfsi.materials.solid.law import IsotropicLaw
from ngfsi.physics.fields import MOTION
from ngfsi.physics.integrals import Integral, OverFaces
from ngfsi.system.sparse import csr
from ngfsi.system.system import BEFORE, System


class Uncondensed(System):
    """A system whose tangent has all unknowns, so that it can be transposed."""

    condenses = False


class Residual(System):
    """A system without tangent: of a case with other constants, on the states of a run."""

    def _tangent_form(self, _space: Any) -> None:
        return None


class Lagrangian(System):
    """A system on whose residual multipliers act.

    Attributes:
        multipliers: of the rows of the form, as the test functions number them.
    """

    multipliers: GridFunction
    _works: Sequence[Integral] = ()
    _linearised: Sequence[Integral] = ()
    _by_symmetry: Sequence[Integral] = ()

    def _setup(self, references: Mapping[str, Any]) -> Setup:
        self._direction = self._test
        self.multipliers = GridFunction(self.unknowns.space)
        self._test = self.named(self.multipliers)
        return replace(super()._setup(references), test=self._test)

    def work_integrals(self, name: str, F: Any, grad_v: Any, *given: Any, **more: Any) -> list[Integral]:
        """As of a system. Where the stresses are the derivative of an energy of invariants, their derivative times
        multipliers is by symmetry that in the direction of the multipliers: a residual, in half of the time."""
        found = super().work_integrals(name, F, grad_v, *given, **more)
        self._works = [*self._works, *found]
        if isinstance(self.solids[name], IsotropicLaw) and not self.case.conditions.plane_stress:
            at = F.MakeVariable()
            tested = super().work_integrals(name, at, ng.Grad(self._direction[MOTION]), *given, **more)
            self._linearised = [*self._linearised, *(
                Integral([part.Diff(at, grad_v) for part in one.integrands], one.measure) for one in tested
            )]  # fmt: skip
            self._by_symmetry = [*self._by_symmetry, *found]
        return found

    def _forms(self, space: Any) -> tuple[Any, Any]:
        integrals = [*self.integrals(), *self.inertia_integrals(self._acceleration, self._test[MOTION])]
        directions = list(self._direction.values())
        at_openings = [one for one in integrals if isinstance(one, OverFaces)]
        apart = [*self._by_symmetry, *at_openings]
        others = [one for one in integrals if not any(one is other for other in apart)]
        self._at_openings = self._linear(space, at_openings, directions)
        self._by_state = gradient_form(
            space, others, list(self._trial.values()), directions, at_points=self._works, linearised=self._linearised
        )
        self._by_histories = [
            gradient_form(space, integrals, field.components, directions, numbers=len(self.unknowns.scales))
            for field in (self.velocity_history, self.acceleration_history)
        ]
        motion = [self.relaxation], [self._direction[MOTION]]
        self._by_relaxation = None if self.relaxation is None else gradient_form(space, self._works, *motion, numbers=0)
        self._rows: Any = None
        self._result = self.state.vec.CreateVector()
        self._remember(space, directions)
        return None, None

    def _remember(self, space: Any, directions: list[Any]) -> None:
        """Prepare the derivatives by what solids remember, and those of its new values by all that they depend on."""
        self._memory = {f"model {region}.{key}": one for region, model in self.solids.items()
                        for key, one in model.internal_variables().items()}  # fmt: skip
        self._owed = {name: GridFunction(one.field.space) for name, one in self._memory.items()}
        updates = [Integral([ng.InnerProduct(self._owed[name], one.new)], one.measure)
                   for name, one in self._memory.items()]  # fmt: skip

        def by_memory(integrals: Sequence[Integral]) -> dict[str, ng.BilinearForm]:
            found = {}
            for name, one in self._memory.items():
                test = one.field.space.TestFunction()
                found[name] = gradient_form(one.field.space, integrals, [one.field], [test], numbers=0)
            if before := self._stored.get(BEFORE):
                found[BEFORE] = gradient_form(space, integrals, before.components, directions, numbers=0)
            return found

        # trial functions are of another space than internal variables
        works = self.works(self.named(self.state)) if self._memory or BEFORE in self._stored else []
        self._by_memory, self._update_by_memory = by_memory(works), by_memory(updates)
        fields = self.state, self.velocity_history, self.acceleration_history
        self._update_by_fields = [
            gradient_form(space, updates, field.components, directions, numbers=0) for field in fields
        ]
        motion = [self.relaxation], [self._direction[MOTION]]
        self._update_by_relaxation = (
            None if self.relaxation is None else gradient_form(space, updates, *motion, numbers=0)
        )

    def set_multipliers(self, values: Array) -> None:
        """Take multipliers of the equations, each in the place of its unknown."""
        self.unknowns.test(values, self.multipliers.vec.FV().NumPy())

    def _linear(self, space: Any, integrals: Sequence[Integral], directions: list[Any]) -> ng.BilinearForm:
        """Return a form whose linearisation is that of integrals: with test functions for the multipliers, in which
        they are linear."""
        form = ng.BilinearForm(space, check_unused=False)
        for integrands, measure in integrals:
            whole = sum(integrands[1:], start=integrands[0])
            pairs = zip(self.multipliers.components, directions, strict=True)
            form += sum((whole.Diff(one, direction) for one, direction in pairs), start=ng.CF(0)).Compile() * measure
        return form

    def restore(self, snapshot: Mapping[str, Array]) -> None:
        """As of a system; what is not applied but multiplied is linearised."""
        super().restore(snapshot)
        self._rows = None

    def by_state(self) -> Array:
        """Return the derivative of multipliers times residual by all unknowns.

        Of openings the matrix takes as long as one or two products at the points of all faces of the elements there.
        """
        found = self._applied(self._by_state)
        if self._at_openings.integrators:
            if self._rows is None:
                self._at_openings.AssembleLinearization(self.state.vec)
                matrix = csr(self._at_openings.mat)
                numbers = np.flatnonzero(abs(matrix) @ np.ones(matrix.shape[1]))
                self._rows = numbers, matrix[numbers].T.tocsr()
            numbers, transposed = self._rows
            found += transposed @ self.multipliers.vec.FV().NumPy()[numbers]
        return found

    def by_histories(self) -> tuple[Array, Array]:
        """Return the derivatives by the histories of the velocity and of the acceleration."""
        first, second = (self._applied(form) for form in self._by_histories)
        return first, second

    def by_relaxation(self) -> Array | None:
        """Return the derivative by the displacement to the shape free of stress, in the places of the motion; None: the
        given shape is free of stress."""
        return None if self._by_relaxation is None else self._applied(self._by_relaxation)

    def by_memory(self) -> dict[str, Array]:
        """Return the derivatives by what solids remember, by its name in snapshots; by the last accepted state those
        by all unknowns."""
        return self._applied_by_name(self._by_memory)

    def set_owed(self, owed: Mapping[str, Array]) -> None:
        """Take a derivative by the new values of internal variables, as of `by_memory`."""
        for name, one in self._memory.items():
            vector = self._owed[name].vec
            vector.FV().NumPy()[:] = owed.get(name, 0.0)
            one.projected(vector)

    def update_by_state(self) -> tuple[Array, Array, Array]:
        """Return the derivatives, by the present state and the histories, of what `set_owed` took times the new values
        of internal variables."""
        first, second, third = (self._applied(form) for form in self._update_by_fields)
        return first, second, third

    def update_by_memory(self) -> dict[str, Array]:
        """Return the derivatives of the same by the old values, as of `by_memory`."""
        return self._applied_by_name(self._update_by_memory)

    def update_by_relaxation(self) -> Array | None:
        """Return the derivative of the same as of `by_relaxation`."""
        return None if self._update_by_relaxation is None else self._applied(self._update_by_relaxation)

    def _applied_by_name(self, forms: Mapping[str, ng.BilinearForm]) -> dict[str, Array]:
        found = {}
        for name, form in forms.items():
            point = self.state.vec if name == BEFORE else self._memory[name].field.vec
            result = point.CreateVector()
            form.Apply(point, result)
            found[name] = np.ravel(result.FV().NumPy()).copy()
        return found

    def _applied(self, form: ng.BilinearForm) -> Array:
        form.Apply(self.state.vec, self._result)
        return np.array(self._result.FV().NumPy())


def gradient_form(
    space: Any, integrals: Sequence[Integral], variables: Sequence[Any], directions: Sequence[Any],
    numbers: int | None = None, at_points: Sequence[Integral] = (), linearised: Sequence[Integral] = (),
) -> ng.BilinearForm:  # fmt: skip
    """Return a form that applies as the derivative of the integrals, which are numbers, by variables.

    On boundaries NGSolve does not differentiate traces by symbols: it differentiates by trial functions at each point
    there, and of grid functions only numbers count. No history but that of a number is in an integral on a boundary of
    ngfsi's own; the check of `adjoint` tells if one is.

    Args:
        variables: trial functions of the space, or grid functions.
        directions: test functions for each variable.
        numbers: of grid functions, how many at the end are single numbers; None: the variables are trial functions.
        at_points: integrals that NGSolve is to differentiate by trial functions at each point, as on boundaries: for
            the stresses of solids, whose second derivatives fill pages, that takes a fifth of the time, and for the
            blood, with more unknowns, up to six times as much.
        linearised: that are derivatives already, in the directions of test functions.
    """
    form = ng.BilinearForm(space, nonassemble=True, check_unused=False)
    # of test functions with values of matrices, as internal variables may be, that finds nothing
    with _by_symbols() if len(directions[0].dims) < 2 else nullcontext():
        for integrands, measure in linearised:
            form += sum(integrands[1:], start=integrands[0]).Compile() * measure
        for one in integrals:
            whole, measure = sum(one.integrands[1:], start=one.integrands[0]), one.measure
            pairs = list(zip(variables, directions, strict=True))
            boundary = on_boundary(space, measure)
            if numbers is None and (boundary or any(one is other for other in at_points)):
                form += ng.Variation(whole.Compile() * measure)
                continue
            if boundary and numbers is not None:
                pairs = pairs[len(pairs) - numbers :]
            change = sum((whole.Diff(variable, direction) for variable, direction in pairs), start=ng.CF(0))
            if not is_zero(change):
                form += change.Compile() * measure
    return form


def on_boundary(space: Any, measure: Any) -> bool:
    """Whether test functions have to be traces under a measure."""
    scalars = ng.H1(space.mesh, order=1)
    form = ng.BilinearForm(scalars, nonassemble=True, check_unused=False)
    try:
        form += ng.Grad(scalars.TestFunction())[0] * measure
    except Exception:  # NGSolve's own: a trace is missing
        return True
    return False


def is_zero(function: Any) -> bool:
    """Whether a coefficient function is zero by its form."""
    return str(function).startswith("ZeroCoefficientFunction")


@contextmanager
def _by_symbols() -> Any:
    """Let NGSolve differentiate integrands by their test functions, as in `system.forms.residual_form`."""
    usual = ng.ngsglobals.symbolic_integrator_uses_diff
    ng.ngsglobals.symbolic_integrator_uses_diff = True
    try:
        yield
    finally:
        ng.ngsglobals.symbolic_integrator_uses_diff = usual
