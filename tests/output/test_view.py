"""The page on which stored runs are looked at: what it shows, and that a browser shows it."""

from __future__ import annotations

import asyncio
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ngfsi.errors import OutputError
from ngfsi.report.view import Viewer
from ngfsi.store.stored import StoredRun, open_run
from tests.output.fake import CASE, fake_run
from tests.output.test_report import BROWSERS

PATIENCE = 120.0


@pytest.fixture
def viewer(stored: StoredRun) -> Viewer:
    return Viewer([stored])


def test_the_history_of_a_place(viewer: Viewer, stored: StoredRun) -> None:
    """Of a material point, which moves: the values that the fields have there."""
    viewer.quantity = "wall_shear_magnitude_Pa"
    start, end = (stored.fields(time, "wall") for time in (viewer.times[0], viewer.times[-1]))
    number = end.n_points // 3
    ((times, values),) = viewer.history(end.points[number])
    assert times.tolist() == stored.field_times()
    assert values[0] == pytest.approx(start.point_data[viewer.quantity][number], rel=1e-6)
    assert values[-1] == pytest.approx(end.point_data[viewer.quantity][number], rel=1e-6)
    assert values[0] != pytest.approx(values[-1], rel=1e-2)
    viewer.quantity = "wall_shear_Pa"
    assert viewer.history(end.points[number])[0][1] == pytest.approx(values, rel=1e-5)


def test_a_plane_cuts_where_it_is(viewer: Viewer) -> None:
    viewer.cut, viewer.at = "across z", 0.25
    viewer.draw()
    whole, half = viewer._mesh(0, viewer.time), viewer.plotter.actors["run 0"].mapper.dataset
    low, high = whole.bounds[4:]
    assert half.bounds[4] == pytest.approx(low, abs=1e-6)
    assert half.bounds[5] == pytest.approx(low + 0.25 * (high - low), rel=1e-5)


def test_runs_are_compared_on_one_scale(stored: StoredRun, tmp_path: Path) -> None:
    other = fake_run(tmp_path / "other", CASE.replace(name="wider"), loss=0.1)
    viewer = Viewer([stored, other])
    viewer.draw()
    ranges = [
        tuple(renderer.actors[f"run {k}"].mapper.scalar_range) for k, renderer in enumerate(viewer.plotter.renderers)
    ]
    assert ranges[0] == ranges[1]
    values = [np.asarray(run.fields(viewer.time, "wall").point_data[viewer.quantity]) for run in (stored, other)]
    assert ranges[0] == pytest.approx((min(map(np.min, values)), max(map(np.max, values))), rel=1e-6)


def test_what_has_no_fields_is_refused(stored: StoredRun, tmp_path: Path) -> None:
    bare = tmp_path / "bare"
    shutil.copytree(stored.path, bare, ignore=shutil.ignore_patterns("*.pvd", "*.vtu", "volume*", "wall*"))
    with pytest.raises(OutputError, match="holds no fields yet"):
        Viewer([open_run(bare)])


@pytest.mark.skipif(not any(map(shutil.which, BROWSERS)), reason="there is no Chrome or Chromium")
def test_the_page_in_a_browser(stored: StoredRun) -> None:
    """It draws the last time, the history of a place that is clicked, and another time when the slider asks for it."""
    command = [sys.executable, "-u", "-m", "ngfsi.cli", "view", str(stored.path), "--no-browser"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        assert server.stdout
        address = next(found[0] for line in server.stdout if (found := re.search(r"http://localhost:\d+", line)))
        first, last = (f"{time:.4g} s" for time in (stored.field_times()[0], stored.field_times()[-1]))
        assert asyncio.run(asyncio.wait_for(_look(address, last, first), PATIENCE))
    finally:
        server.kill()
        server.wait()


async def _look(address: str, last: str, first: str) -> bool:
    from choreographer import Browser

    browser = next(filter(None, map(shutil.which, BROWSERS)))
    async with Browser(path=browser, headless=True, enable_sandbox=False) as chrome:
        tab = await chrome.create_tab(address)
        await _until(tab, f"document.body && document.body.innerText.includes({last!r})")
        # the picture comes over the same connection
        await _until(tab, "[...document.images].some(one => one.naturalWidth > 100)")
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            where = {"x": 380, "y": 270, "button": "left", "clickCount": 1, "buttons": int(kind == "mousePressed")}
            await tab.send_command("Input.dispatchMouseEvent", params={"type": kind, **where})
        await _until(tab, "[...document.images].some(one => one.src.startsWith('data:image/svg'))")
        await tab.send_command("Runtime.evaluate", params={"expression": "window.trame.state.set('step', 0)"})
        return await _until(tab, f"document.body.innerText.includes({first!r})")


async def _until(tab: Any, expression: str) -> bool:
    while True:
        said = await tab.send_command("Runtime.evaluate", params={"expression": expression})
        if said["result"]["result"].get("value") is True:
            return True
        await asyncio.sleep(0.3)
