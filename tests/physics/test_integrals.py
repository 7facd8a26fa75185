"""Integration rules are exact for the polynomials that they are said to be exact for, and for no others."""

from __future__ import annotations

from itertools import product
from math import factorial

import ngsolve as ng
import numpy as np
import pytest

from ngfsi.physics.integrals import form_rules


def error_of(rule: ng.IntegrationRule, degree: int) -> float:
    """Return the largest relative error of the monomials of a degree over the reference tetrahedron."""
    points, weights = np.array([p.point for p in rule]), np.array([p.weight for p in rule])
    errors = []
    for powers in product(range(degree + 1), repeat=3):
        if sum(powers) == degree:
            exact = np.prod([factorial(k) for k in powers]) / factorial(degree + 3)
            errors.append(abs(weights @ np.prod(points ** np.array(powers), axis=1) / exact - 1))
    return max(errors)


@pytest.mark.parametrize("beyond", [0, 1])
def test_tetrahedra_of_order_2_are_integrated_to_third_order_with_8_points(beyond: int) -> None:
    rule = form_rules(2, beyond)[ng.TET]
    assert len(rule) == 8
    assert min(p.weight for p in rule) > 0
    assert [error_of(rule, degree) for degree in range(4)] == pytest.approx([0.0] * 4, abs=1e-13)
    assert error_of(rule, 4) > 0.01


def test_higher_orders_are_integrated_to_them() -> None:
    for k, beyond, extra in ((2, 0, 1), (3, 0, 0), (3, 1, 0), (3, 1, 1)):
        order = 2 * k + beyond + extra
        assert error_of(form_rules(k, beyond, extra)[ng.TET], order) == pytest.approx(0.0, abs=1e-12)
