"""Integrands with their measures, and the integration rules of the weak form."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import ngsolve as ng

SHAPES = (ng.SEGM, ng.TRIG, ng.QUAD, ng.TET, ng.PRISM, ng.HEX, ng.PYRAMID)


class Integral(NamedTuple):
    """Integrands, linear in the test functions, and their measure."""

    integrands: Sequence[Any]
    measure: Any


class OverFaces(Integral):
    """One over the boundaries of a few elements, of which a face counts: linearised it is a small matrix."""


def rules(order: int) -> dict[Any, ng.IntegrationRule]:
    """Return an integration rule for each shape of element.

    NGSolve's own choice for simplices depends on the derivatives in an integrand: a sum and its parts would differ.
    """
    return {shape: ng.IntegrationRule(shape, order) for shape in SHAPES}


def form_rules(k: int, beyond: int = 0, extra: int = 0) -> dict[Any, ng.IntegrationRule]:
    """Return rules for the weak form on elements of an order k, in tetrahedra of order 2 with 8 points.

    NGSolve has 14 for the orders 3 to 5. On straight ones strains of order 2 are linear, and the 8 are exact to order
    3, one more than the elements' own error asks for (Ciarlet, The finite element method for elliptic problems, 1978,
    section 4.1).

    Args:
        beyond: order beyond 2 k in other elements.
        extra: more of it in all elements, which then have NGSolve's rules.
    """
    found = rules(2 * k + beyond + extra)
    if k == 2 and not extra:
        found[ng.TET] = _of_eight_points()
    return found


def _of_eight_points() -> ng.IntegrationRule:
    """Return the rule of third order in two orbits of four points (Keast, CMAME 55, 1986)."""
    orbits = (0.328054696711427, 0.138527966511862), (0.106952273932930, 0.111472033488138)
    points = [tuple(1 - 3 * near if i == k else near for i in range(3)) for near, _ in orbits for k in range(4)]
    return ng.IntegrationRule(points, [weight / 6 for _, weight in orbits for _ in range(4)])


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
