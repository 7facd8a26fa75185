"""Designs of studies: spread as they should be, and sensitivity indices that are known exactly."""

from __future__ import annotations

import numpy as np
import pytest

from ngfsi.errors import CaseError, MaterialError
from ngfsi.study.design import grid, indices, latin_hypercube, morris, one_at_a_time, saltelli, sobol
from tests.output.fake import CASE

RANGES = {"materials.tissue.K_kPa": (20.0, 40.0), "geometry.lumen_diameter_mm": (8.0, 11.0)}


def test_grid_and_one_at_a_time() -> None:
    values = {"a": [1, 2], "b": [5, 6, 7]}
    assert grid(values).points.tolist() == [[1, 5], [1, 6], [1, 7], [2, 5], [2, 6], [2, 7]]
    single = one_at_a_time({"a": 1.5, "b": 6}, values)
    assert single.points.tolist() == [[1.5, 6], [1, 6], [2, 6], [1.5, 5], [1.5, 6], [1.5, 7]]
    assert single.ranges.tolist() == [[1, 2], [5, 7]]


def test_points_are_even_along_each_factor() -> None:
    """One point in each of as many slices of each range; of Sobol's sequence also one in each box of a 4 x 4 grid."""
    for design in (latin_hypercube(RANGES, 16, seed=3), sobol(RANGES, 16, seed=3)):
        low, high = design.ranges.T
        unit = (design.points - low) / (high - low)
        for column in unit.T:
            assert sorted(np.floor(16 * column).astype(int)) == list(range(16))
    boxes = {(int(4 * x), int(4 * y)) for x, y in unit}
    assert len(boxes) == 16
    assert np.array_equal(sobol(RANGES, 16, seed=3).points, design.points)
    assert not np.array_equal(sobol(RANGES, 16, seed=4).points, design.points)
    with pytest.raises(CaseError, match="12 points of Sobol's sequence are not balanced"):
        sobol(RANGES, 12)


def test_cases_have_the_values_in_their_units() -> None:
    design = sobol(RANGES, 4)
    cases = design.cases(CASE)
    assert list(cases) == ["0", "1", "2", "3"]
    for case, (bulk, lumen) in zip(cases.values(), design.points, strict=True):
        assert pytest.approx(1e3 * bulk, rel=1e-15) == case.materials.tissue.K
        assert case.geometry.lumen_diameter == pytest.approx(1e-3 * lumen, rel=1e-15)
    with pytest.raises(MaterialError, match=r"'materials\.tissue\.L_kPa' is not a known key"):
        grid({"materials.tissue.L_kPa": [1.0]}).cases(CASE)


def test_sobol_indices_of_ishigamis_function() -> None:
    """sin x + 7 sin^2 y + 0.1 z^4 sin x: S1 = 0.3139, 0.4424, 0; ST = 0.5576, 0.4424, 0.2437 (Ishigami 1990)."""
    design = saltelli(dict.fromkeys("xyz", (-np.pi, np.pi)), 2048, seed=1)
    x, y, z = design.points.T
    found = indices(design, list(np.sin(x) + 7 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)))
    np.testing.assert_allclose(found.first, [0.3139, 0.4424, 0.0], atol=0.02)
    np.testing.assert_allclose(found.second, [0.5576, 0.4424, 0.2437], atol=0.02)
    assert np.all(np.abs(found.first - [0.3139, 0.4424, 0.0]) < 2 * found.first_half_width)


def test_elementary_effects_of_a_plane() -> None:
    """Their mean is the slope over the range (SALib scales by it), the same everywhere."""
    design = morris({"a": (0.0, 2.0), "b": (10.0, 20.0)}, 6, seed=2)
    found = indices(design, list(3 * design.points[:, 0] - 0.5 * design.points[:, 1]))
    np.testing.assert_allclose(found.first, [6.0, 5.0], rtol=1e-12)
    np.testing.assert_allclose(found.second, 0.0, atol=1e-12)


def test_indices_need_every_result_and_their_design() -> None:
    design = saltelli(RANGES, 4)
    with pytest.raises(CaseError, match="a finite result at every point"):
        indices(design, [np.nan] * len(design.points))
    with pytest.raises(CaseError, match="need a design by saltelli or morris"):
        indices(sobol(RANGES, 4), [1.0] * 4)
