"""Pressure around the wall of a stored run whose pressure is known: 0.1 kPa per mm of the lateral position."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ngfsi.analysis.transmission import Surroundings, transmission
from ngfsi.store.stored import StoredRun
from tests.output.fake import GEOMETRY

RADIUS = GEOMETRY.lumen_radius + GEOMETRY.wall_thickness


def test_by_angle(stored: StoredRun) -> None:
    found = Surroundings.of(stored, 1.5)
    assert found.pressure == pytest.approx(1e5 * (GEOMETRY.vein_x + RADIUS * np.cos(found.angle)), abs=2.0)
    angle, pressure = found.by_angle()
    there = np.isfinite(pressure)
    assert there.sum() > 12
    # nodes lie anywhere in a sector of 15 degrees
    exact = 1e5 * (GEOMETRY.vein_x + RADIUS * np.cos(angle))
    assert np.abs(pressure - exact)[there].max() < 1e5 * RADIUS * np.pi / 24


def test_transmission(stored: StoredRun) -> None:
    """Half of 4 kPa more on the skin arrives; at first there is nothing to transmit. With cuffs the mean counts."""
    skin, wall = np.array([500.0, 500.0, 4500.0]), np.array([1500.0, 1600.0, 3500.0])
    for column in ("skin_pressure_Pa", "skin_pressure_mean_Pa"):
        run = replace(stored)
        run.__dict__["series"] = {"skin_pressure_Pa": 0 * skin, column: skin, "p_tissue_side_Pa": wall}
        found = transmission(run)
        assert np.isnan(found[:2]).all()
        assert found[2] == pytest.approx(0.5)


def test_pressure_on_the_skin_is_uneven_from_a_thousandth_on(stored: StoredRun) -> None:
    """Its largest value is said beside its mean, also of suction."""
    run = replace(stored)
    mean = np.array([1000.0, 1000.0, -1000.0])
    most = np.array([1000.9, 1001.1, -998.9])
    run.__dict__["series"] = {"time_s": np.arange(3.0), "skin_pressure_mean_Pa": mean, "skin_pressure_max_Pa": most}
    assert [run.on_skin(time) for time in (0.0, 1.0, 2.0)] == [[1000.0], [1000.0, 1001.1], [-1000.0, -998.9]]
