"""Resistance of laws to shear bands against Saint Venant-Kirchhoff's acoustic tensor in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from ngfsi.materials import load_set
from ngfsi.measure.ellipticity import Ellipticity, extreme, principal_stretches
from tests.vein import TISSUE, WALL

RESTING = np.ones((1, 3))
SETS = ("vein_wall_source", "mooney_rivlin_s1", "neo_hookean_likely")


@pytest.mark.parametrize("law", [*map(load_set, SETS), TISSUE], ids=lambda law: law.label)
def test_at_rest_the_slowest_wave_is_of_shear(law) -> None:  # type: ignore[no-untyped-def]
    assert Ellipticity(law).smallest(RESTING) == pytest.approx([1.0], rel=1e-5)


def test_against_the_closed_form_in_all_directions() -> None:
    """a . Q a = n . S n + mu (|F^T a|^2 + (n . F^T a)^2) + lambda (n . F^T a)^2 for unit a and n."""
    stretches = np.sort(np.random.default_rng(3).uniform(0.6, 1.4, (40, 3)), axis=1)
    mu, lame = WALL.shear_modulus, WALL.lame
    normal = np.random.default_rng(4).standard_normal((20_000, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    wanted = []
    for stretch in stretches:
        strain = (stretch**2 - 1) / 2
        stress = lame * strain.sum() + 2 * mu * strain
        moved = normal * stretch
        acoustic = (lame + mu) * moved[:, :, None] * moved[:, None, :] + np.eye(3) * (
            (normal**2 @ stress)[:, None, None] + mu * stretch**2
        )
        wanted.append(np.linalg.eigvalsh(acoustic)[:, 0].min() / mu)
    found = Ellipticity(WALL).smallest(stretches)
    assert np.count_nonzero(found < 0) > 5 < np.count_nonzero(found > 0)
    np.testing.assert_allclose(found, wanted, rtol=0.02, atol=0.02)


def test_the_extremes_are_among_the_chosen() -> None:
    stretches = np.sort(np.random.default_rng(5).uniform(0.5, 2.0, (1000, 3)), axis=1)
    chosen = set(extreme(stretches))
    assert {stretches[:, 0].argmin(), stretches[:, 2].argmax(), stretches.prod(axis=1).argmin()} <= chosen
    assert len(chosen) <= 60


def test_principal_stretches() -> None:
    random = np.random.default_rng(7)
    F = np.eye(3) + random.uniform(-0.5, 0.5, (200, 3, 3))
    F[0], F[1] = np.eye(3), np.diag([2.0, 2.0, 0.5])
    found = principal_stretches(F)
    np.testing.assert_allclose(found, np.linalg.svd(F, compute_uv=False)[:, ::-1], rtol=1e-7)
