"""Bilinear forms of residual and tangent from the same integrands, each as NGSolve evaluates it fastest.

Terms that share a measure are one part. Machine code (`realcompile`) was measured and left out: the residual would take
as long as it does now, the tangent 10 % less, for half a minute of compiling.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import ngsolve as ng

SHAPES = (ng.TRIG, ng.QUAD, ng.TET, ng.PRISM, ng.HEX, ng.PYRAMID)


def rules(order: int) -> dict[Any, ng.IntegrationRule]:
    """Return an integration rule for each shape of element.

    NGSolve's own choice for simplices depends on the derivatives in an integrand: a sum and its parts would differ.
    """
    return {shape: ng.IntegrationRule(shape, order) for shape in SHAPES}


def reduced_rules(order: int) -> dict[Any, ng.IntegrationRule]:
    """Return rules for the resistance to changes of volume of elements of an order k, with k points along each axis.

    They ask for nothing else than a pressure of order k - 1, discontinuous between elements, would (Malkus and Hughes,
    CMAME 15, 1978). Simplices bear one order less, and so do the triangles of a prism.
    """
    along, across = 2 * order - 1, 2 * order - 3
    found = {shape: ng.IntegrationRule(shape, across if shape in (ng.TRIG, ng.TET) else along) for shape in SHAPES}
    triangle, line = ng.IntegrationRule(ng.TRIG, across), ng.IntegrationRule(ng.SEGM, along)
    points = [(*p.point[:2], q.point[0]) for p in triangle for q in line]
    found[ng.PRISM] = ng.IntegrationRule(points, [p.weight * q.weight for p in triangle for q in line])
    return found


class Part(NamedTuple):
    """Integrands, linear in the test functions, and their measure."""

    integrands: Sequence[Any]
    measure: Any


def residual_form(space: Any, parts: Sequence[Part]) -> ng.BilinearForm:
    """Return a form to apply; it has no matrix.

    Each part is one integrand, which NGSolve differentiates by its test functions: it then evaluates a stress once,
    and not once for each component of each test function, which is 12 times for a solid.
    """
    form = ng.BilinearForm(space, nonassemble=True, check_unused=False)
    usual = ng.ngsglobals.symbolic_integrator_uses_diff
    ng.ngsglobals.symbolic_integrator_uses_diff = True
    try:
        for integrands, measure in parts:
            form += sum(integrands[1:], start=integrands[0]).Compile() * measure
    finally:
        ng.ngsglobals.symbolic_integrator_uses_diff = usual
    return form


def tangent_form(space: Any, parts: Sequence[Part], *, condense: bool = False) -> ng.BilinearForm:
    """Return a form to linearise.

    Each integrand is one integral: NGSolve evaluates it for every pair of components of its trial and its test
    functions, and they are the fewer, the less it has of both.
    """
    form = ng.BilinearForm(space, condense=condense, check_unused=False)
    for integrands, measure in parts:
        for integrand in integrands:
            form += integrand.Compile() * measure
    return form
