"""Values of a displacement on a boundary of the plane from a function of its points, which NGSolve cannot evaluate."""

from __future__ import annotations

from collections.abc import Callable

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array
from ngfsi.mesh.domain import Domain


def boundary_values(domain: Domain, name: str, order: int, function: Callable[[Array], Array]) -> Array:
    """Return the unknowns of a plane VectorH1 of an order that fit a function on a boundary best, all others zero.

    Args:
        function: of points (n, 2) [m] of the reference shape, returns vectors (n, 2).
    """
    region, scalar = domain.boundaries(name), ng.H1(domain.mesh, order=order)
    rule = ng.IntegrationRule(ng.SEGM, 2 * order + 1)
    points = np.asarray(ng.CF((ng.x, ng.y))(domain.mesh.MapToAllElements({ng.SEGM: rule}, region)))
    numbers = np.flatnonzero(list(scalar.GetDofs(region)))
    place = np.full(scalar.ndof, -1)
    place[numbers] = np.arange(len(numbers))
    shapes = np.zeros((len(points), len(numbers)))
    for first, element in zip(range(0, len(points), len(rule)), region.Elements(), strict=True):
        finite, mine = scalar.GetFE(element), place[list(scalar.GetDofNrs(element))]
        for row, point in enumerate(rule, start=first):
            shapes[row, mine] = np.asarray(finite.CalcShape(*point.point))
    fitted = np.linalg.lstsq(shapes, function(points), rcond=None)[0]
    values = np.zeros((2, scalar.ndof))
    values[:, numbers] = fitted.T
    return values.ravel()
