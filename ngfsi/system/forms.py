"""Bilinear forms of residual and tangent from the same integrands, each as NGSolve evaluates it fastest.

Terms of one measure are one integral. Machine code (`realcompile`) was measured and left out: the residual would take
as long as it does now, the tangent 10 % less, for half a minute of compiling.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array, Numbers
from ngfsi.physics.integrals import Integral
from ngfsi.system.sparse import csr, pattern, ranges
from ngfsi.system.unknowns import Within


def residual_form(space: Any, parts: Sequence[Integral]) -> ng.BilinearForm:
    """Return a form to apply; it has no matrix.

    Each part is one integrand, which NGSolve differentiates by its test functions: it then evaluates a stress once,
    and not once for each component of each test function, which is 12 times for a solid.
    """
    form = ng.BilinearForm(space, nonassemble=True, check_unused=False)
    _add(form, [(sum(integrands[1:], start=integrands[0]), measure) for integrands, measure in parts])
    return form


def linear_form(space: Any, parts: Sequence[tuple[Any, Any]]) -> ng.LinearForm:
    """Return a form to assemble, of integrands with their measures, each differentiated as by `residual_form`."""
    form = ng.LinearForm(space)
    _add(form, parts)
    return form


def _add(form: Any, parts: Sequence[tuple[Any, Any]]) -> None:
    usual = ng.ngsglobals.symbolic_integrator_uses_diff
    ng.ngsglobals.symbolic_integrator_uses_diff = True
    try:
        for integrand, measure in parts:
            form += integrand.Compile() * measure
    finally:
        ng.ngsglobals.symbolic_integrator_uses_diff = usual


def tangent_form(space: Any, parts: Sequence[Integral], *, condense: bool = False) -> ng.BilinearForm:
    """Return a form to linearise.

    Each integrand is one integral: NGSolve evaluates it for every pair of components of its trial and its test
    functions, and they are the fewer, the less it has of both.
    """
    form = ng.BilinearForm(space, condense=condense, check_unused=False)
    for integrands, measure in parts:
        for integrand in integrands:
            form += integrand.Compile() * measure
    return form


class Part:
    """A residual form on a space of its own, of some of the fields on some regions.

    NGSolve passes through elements of order 2 in up to a third less time than if they had all unknowns.
    """

    def __init__(self, where: Within, integrals: Sequence[Integral]) -> None:
        self._form = residual_form(where.space, integrals)
        self._state, self._residual = (ng.GridFunction(where.space).vec for _ in range(2))
        self._here, self._there = np.concatenate(where.here), np.concatenate(where.there)

    def take(self, values: Array) -> Array:
        """Take the values of all unknowns; return those of the own ones."""
        own = np.asarray(self._state.FV().NumPy())
        own[self._here] = values[self._there]
        return own

    def add(self, values: Array, residual: Array) -> None:
        """Add the residual at the values of all unknowns."""
        self.take(values)
        self._form.Apply(self._state, self._residual)
        residual[self._there] += self._residual.FV().NumPy()[self._here]


class PartOfBlood(Part):
    """That of the blood, whose velocity and acceleration are fields of the space, too.

    At integration points the sums that rates are would take a fifth of the time.
    """

    def __init__(
        self,
        where: Within,
        integrals: Sequence[Integral],
        new: Any,
        velocity_history: Array,
        acceleration_history: Array,
    ) -> None:
        """Prepare.

        Args:
            where: with motion, relative velocity and pressure, and for two more vectors.
            new: weight of the new state in the rates.
            velocity_history, acceleration_history: of all unknowns.
        """
        super().__init__(where, integrals)
        self._new, self._histories = new, (velocity_history, acceleration_history)
        self._parts = [slice(where.space.Range(i).start, where.space.Range(i).stop) for i in (3, 4)]
        (m, w, _), self._moved, self._flowing = where.here, where.there[0], where.there[1]
        self._of_motion, self._of_velocity = m, w - where.space.Range(1).start

    def take(self, values: Array) -> Array:
        own, new = super().take(values), self._new.Get()
        of_velocity, of_acceleration = self._histories
        u, a = (own[part] for part in self._parts)
        u[self._of_motion] = new * values[self._moved] + of_velocity[self._moved]
        u[self._of_velocity] += values[self._flowing]
        a[self._of_motion] = new * u[self._of_motion] + of_acceleration[self._moved]
        a[self._of_velocity] += of_velocity[self._flowing]
        return own


class WithParts:
    """A residual form to which parts are added."""

    def __init__(self, form: ng.BilinearForm, parts: Sequence[Part]) -> None:
        self.space, self._form, self._parts = form.space, form, parts

    def Apply(self, state: Any, residual: Any) -> None:
        """Write the residual at `state`."""
        self._form.Apply(state, residual)
        for part in self._parts:
            part.add(state.FV().NumPy(), residual.FV().NumPy())


class WithInertia:
    """A residual form to which forces of inertia are added as a matrix, made once, times the accelerations.

    At the integration points NGSolve would take a third of the residual's time for them.
    """

    def __init__(self, form: Any, mass: ng.BilinearForm, motion: Any, acceleration: Callable[[Array], Array]) -> None:
        """Prepare.

        Args:
            mass: that of one component of the motion; assembled here.
            motion: the space of the motion, whose unknowns are the first of all.
            acceleration: takes the values of all unknowns and returns the rates of the rates of the motion's.
        """
        self._form, self._acceleration = form, acceleration
        mass.Assemble()
        self._mass = csr(mass.mat).copy()
        self._parts = [slice(motion.Range(i).start, motion.Range(i).stop) for i in range(len(motion.components))]

    def Apply(self, state: Any, residual: Any) -> None:
        """Write the residual at `state`."""
        self._form.Apply(state, residual)
        values, acceleration = residual.FV().NumPy(), self._acceleration(state.FV().NumPy())
        for part in self._parts:
            values[part] += self._mass @ acceleration[part]


class WithoutRows:
    """A form without what another one, whose terms it has too, contributes to some of its equations.

    Both are of one space; condensation would spread the terms to be left out over other equations.
    """

    condense = False

    def __init__(self, whole: ng.BilinearForm, part: ng.BilinearForm, rows: Numbers) -> None:
        """Prepare; `rows`: numbers of the equations."""
        self._whole, self._part, self._rows = whole, part, rows
        self.space = whole.space
        self._entries: tuple[Numbers, Numbers] | None = None

    @property
    def mat(self) -> Any:
        """The matrix of the last linearisation."""
        return self._whole.mat

    def Apply(self, state: Any, residual: Any) -> None:
        """Write the residual at `state`."""
        other = residual.CreateVector()
        self._whole.Apply(state, residual)
        self._part.Apply(state, other)
        residual.FV().NumPy()[self._rows] -= other.FV().NumPy()[self._rows]

    def AssembleLinearization(self, state: Any) -> None:
        """Linearise at `state`."""
        self._whole.AssembleLinearization(state)
        self._part.AssembleLinearization(state)
        values, other = (form.mat.AsVector().FV().NumPy() for form in (self._whole, self._part))
        if self._entries is None:
            self._entries = self._common_entries()
        here, there = self._entries
        values[here] -= other[there]

    def _common_entries(self) -> tuple[Numbers, Numbers]:
        """Return where the entries of the rows of the part are in both matrices."""
        places, keys = [], []
        for form in (self._whole, self._part):
            columns, starts = pattern(form.mat)
            place = ranges(starts[self._rows], starts[self._rows + 1])
            places.append(place)
            keys.append(np.repeat(self._rows, np.diff(starts)[self._rows]) * form.space.ndof + columns[place])
        order = np.argsort(keys[0])
        found = order[np.searchsorted(keys[0], keys[1], sorter=order)]
        return places[0][found], places[1]
