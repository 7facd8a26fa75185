"""Figures: drawn with the values they are given."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from ngfsi_studies import figures as of_studies
from ngfsi_studies.figures import (
    Effects,
    Group,
    SkinPressure,
    elementary_effects,
    outlines,
    skin_pressures,
    time_series,
)

from ngfsi.outlines.outline import polygon_area
from ngfsi.report import figures
from ngfsi.report.figures import COLOURS, Convergence, convergence, results_over_inputs
from ngfsi.store.stored import StoredRun
from ngfsi.units import MMHG, Shown


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """The figures that are made during a test."""
    made: list[Figure] = []
    original = figures.new_figure

    def keep(*size: Any) -> tuple[Figure, Any]:
        figure, axes = original(*size)
        made.append(figure)
        return figure, axes

    for module in (figures, of_studies):
        monkeypatch.setattr(module, "new_figure", keep)
    return made


def other(stored: StoredRun, factor: float, rows: int) -> StoredRun:
    """Return the run with its SAWSS scaled and cut after some rows, as if it had failed."""
    run = replace(stored, manifest={**stored.manifest, "status": "failed"})
    series = {name: column[:rows] for name, column in stored.series.items()}
    run.__dict__["series"] = {**series, "sawss_Pa": factor * series["sawss_Pa"]}
    return run


def lines(axes: Axes, colour: str) -> list[Any]:
    return [line for line in axes.get_lines() if line.get_color() == colour and len(line.get_xdata())]


def test_time_series(stored: StoredRun, tmp_path: Path, drawn: list[Figure]) -> None:
    failed = other(stored, 2.0, 4)
    groups = [Group("M", stored, (failed,), "M, others", COLOURS[0]), Group("N", failed, colour=COLOURS[1])]
    path = tmp_path / "sawss.png"
    time_series(
        groups,
        lambda run: run.series["sawss_Pa"],
        Shown("SAWSS", "Pa"),
        path,
        comparison=("developed", lambda run: run.series["sawss_poiseuille_local_Pa"]),
        events=[(1.0, "full pressure")],
    )
    axes = drawn[0].axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time [s]", "SAWSS [Pa]")
    solid, dashed = lines(axes, COLOURS[0])
    np.testing.assert_array_equal(solid.get_ydata(), stored.series["sawss_Pa"])
    np.testing.assert_array_equal(dashed.get_ydata(), stored.series["sawss_poiseuille_local_Pa"])
    _, cross, _ = lines(axes, COLOURS[1])
    assert (cross.get_marker(), list(cross.get_xdata())) == ("X", [0.75])
    labels = [text.get_text() for text in drawn[0].legends[0].get_texts()]
    assert labels == ["M", "M, others", "N", "developed"]
    assert matplotlib.image.imread(path).std() > 0.05


def test_the_band_ends_where_its_runs_end(stored: StoredRun) -> None:
    failed = other(stored, 2.0, 4)
    times = stored.series["time_s"]
    low, high = of_studies._range((stored, failed), lambda run: run.series["sawss_Pa"], times)
    np.testing.assert_array_equal(low, stored.series["sawss_Pa"])
    np.testing.assert_allclose(high, stored.series["sawss_Pa"] * [2, 2, 2, 2, 1, 1, 1])


def test_outlines(stored: StoredRun, tmp_path: Path, drawn: list[Figure]) -> None:
    outlines([Group("M", stored), Group("N", stored)], (0.0, 1.5), tmp_path / "outlines.png")
    panels = drawn[0].axes
    assert [panel.get_title() for panel in panels] == ["M", "N"]
    before, after = (polygon_area(np.column_stack(line.get_data())) for line in panels[0].get_lines())
    assert after / before == pytest.approx(0.75)
    assert before == pytest.approx(np.pi * 5.55**2 * 1.1, rel=5e-3)  # mm2; a polygon of 48 points
    assert np.ptp(panels[0].get_xlim()) == pytest.approx(np.ptp(panels[0].get_ylim()))
    assert "mm" in panels[0].get_xlabel()


def test_polygon_area() -> None:
    square = np.array([[0.0, 0], [2, 0], [2, 3], [0, 3]])
    assert polygon_area(square) == 6
    assert polygon_area(np.vstack([square, square[:1]])[::-1]) == 6


def test_convergence(tmp_path: Path, drawn: list[Figure]) -> None:
    sizes = (1.0, 0.5, 0.25)
    lines = [Convergence("k = 2", sizes, (0.08, 0.01, 0.00125), 3.0), Convergence("k = 3", sizes, (0.02, 0.001, 1e-4))]
    convergence({"velocity": lines, "pressure": lines[:1]}, tmp_path / "convergence.png")
    left, right = drawn[0].axes
    assert (left.get_title(), right.get_title(), left.get_xscale()) == ("velocity", "pressure", "log")
    computed, slope, other = left.get_lines()
    np.testing.assert_allclose(slope.get_ydata(), computed.get_ydata())  # of third order indeed
    assert other.get_label() == "k = 3"
    assert [tick.get_text() for tick in left.get_xticklabels()] == ["0.25", "0.5", "1"]


def test_elementary_effects(tmp_path: Path, drawn: list[Figure]) -> None:
    """Sorted bars with their confidence, and the same factors in the plane of mu* and sigma."""
    effects = Effects(["a", "b", "c"], np.array([1.0, 3.0, 2.0]), np.array([0.1, 0.3, 0.2]), np.array([0.5, 1.0, 0.0]))
    elementary_effects({"loss [%]": effects, "SAWSS [Pa]": effects}, tmp_path / "effects.png")
    bars, plane, *_ = drawn[0].axes
    assert bars.get_title() == "loss [%]"
    assert [bar.get_width() for bar in bars.patches] == [1.0, 2.0, 3.0]
    assert [tick.get_text() for tick in bars.get_yticklabels()] == ["a", "c", "b"]
    (error,) = (c for c in bars.collections)
    assert [np.ptp(part[:, 0]) for part in error.get_segments()] == pytest.approx([0.2, 0.4, 0.6])
    points = plane.get_lines()[0].get_xydata()
    np.testing.assert_array_equal(points, [[1.0, 0.5], [3.0, 1.0], [2.0, 0.0]])


def test_results_over_inputs(tmp_path: Path, drawn: list[Figure]) -> None:
    results_over_inputs({"a_mm": [1, 2], "b_Pa": [5, 6]}, {"x_1": [3, 4], "y_1": [7, 9]}, tmp_path / "all.png")
    panels = drawn[0].axes
    pairs = [(list(line.get_xdata()), list(line.get_ydata())) for panel in panels for line in panel.get_lines()]
    assert pairs == [([1, 2], [3, 4]), ([5, 6], [3, 4]), ([1, 2], [7, 9]), ([5, 6], [7, 9])]
    assert [panel.get_ylabel() for panel in panels[::2]] == ["x_1", "y_1"]
    assert [panel.get_xlabel() for panel in panels[2:]] == ["a_mm", "b_Pa"]


def test_skin_pressures(tmp_path: Path, drawn: list[Figure]) -> None:
    angles, heights = (part.ravel() for part in np.meshgrid(np.linspace(-180, 180, 9), np.linspace(0, 120, 5)))
    times = np.linspace(0, 2, 5)
    chambers = {"distal": MMHG * (20 + times), "proximal": 5 * MMHG * times}
    pressure = SkinPressure(np.radians(angles), 1e-3 * heights, MMHG * (10 + heights / 12), times, chambers)
    skin_pressures({"graduated": pressure, "other": pressure}, tmp_path / "skin.png")
    above, _, below, _, scale = drawn[0].axes
    assert (above.get_title(), above.get_ylabel(), below.get_ylabel()) == (
        "graduated", "height [mm]", "pressure [mmHg]"
    )  # fmt: skip
    np.testing.assert_allclose([line.get_ydata() for line in below.get_lines()], [20 + times, 5 * times])
    assert (above.get_xlabel(), below.get_xlabel()) == ("angle [deg]", "time in the cycle [s]")
    assert above.dataLim.extents == pytest.approx([-180, 0, 180, 120])
    assert scale.get_ylabel() == "mean pressure [mmHg]"
    assert scale.get_ylim()[1] == pytest.approx(20)


def test_a_figure_for_paper(tmp_path: Path) -> None:
    """Beside each PNG lies a PDF of the same size in points, whose text is in TrueType fonts."""
    path = tmp_path / "a.png"
    figure, axes = figures.new_figure(3.4, 2.0)
    axes.set_xlabel("time [s]")
    figure.savefig(path)
    printed = path.with_suffix(".pdf").read_bytes()
    box = re.search(rb"MediaBox \[ ?0 0 ([\d.]+) ([\d.]+) ?\]", printed)
    assert box
    assert [float(box[1]) / 72, float(box[2]) / 72] == pytest.approx([3.4, 2.0], rel=1e-3, abs=0)
    assert b"/CIDFontType2" in printed
    assert b"/Type3" not in printed
