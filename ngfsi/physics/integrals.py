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
