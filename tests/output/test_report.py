"""The HTML report: what it says and draws, and that a browser shows it."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from queue import Queue
from threading import Thread
from typing import Any

import numpy as np
import PIL.Image
import pytest

from ngfsi.errors import OutputError
from ngfsi.report import html as report_module
from ngfsi.report.html import figures, report
from ngfsi.store.folder import RunFolder
from ngfsi.store.stored import StoredRun
from tests.output.fake import CASE, fake_run

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
CLAIMS = {
    "citation": "a book", "remark": "It says no more.", "volume_reduction_percent": {"M": 30.0},
    "sawss_rise_percent": {"M": 205.0}, "hydrostatic_pressure_kPa": {"M": 5.83},
}  # fmt: skip

LISTEN = """<script>window.failures = [];
window.addEventListener('error', e => failures.push(String(e.message)));
console.error = (...said) => failures.push(said.join(' '));</script>"""
LOOK = """<script>window.addEventListener('load', async () => {
  const found = {};
  for (const chart of document.querySelectorAll('.js-plotly-plot')) {
    const image = new Image();
    image.src = await Plotly.toImage(chart, {format: 'png', width: 300, height: 250});
    await image.decode();
    const canvas = document.createElement('canvas');
    [canvas.width, canvas.height] = [300, 250];
    const pen = canvas.getContext('2d');
    pen.drawImage(image, 0, 0);
    // without the colour bar at the right
    found[chart.id] = new Set(new Uint32Array(pen.getImageData(0, 30, 220, 180).data.buffer)).size;
  }
  await fetch('/looked', {method: 'POST', body: JSON.stringify({failures: window.failures, colours: found})});
});</script>"""
PATIENCE = 240.0
"""Seconds: without a graphics card a scene takes some."""


@pytest.fixture(scope="module")
def page(stored: StoredRun, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    other = fake_run(folder / "other", CASE.replace(name="wider", **{"time.step": 0.5}), loss=0.1)
    return report([stored.path, other.path], folder / "report.html", CLAIMS)


def test_what_it_says(page: Path) -> None:
    text = re.sub(r"<script.*?</script>", "", page.read_text(encoding="utf-8"), flags=re.S)
    assert "Not shown" not in text
    # what differs comes first
    assert re.search(r'<tr class="differs"><td>time.step_s</td><td>0.25</td><td>0.5</td>', text)
    differing = re.findall(r'<tr class="differs"><td>(.*?)</td>', text)
    assert all(key.startswith("time.") for key in differing)
    assert "<b>25.0</b>" in text
    assert "<b>10.0</b>" in text
    ratio = 1.5 * 0.75**-1.5
    assert f"<b>{ratio:.2f}</b>" in text
    assert "fake (M): volume reduction %</td><td>30</td><td>25</td><td>-5</td>" in text
    # the mean over the wall, not the 5 kPa of its outer face
    assert "fake (M): hydrostatic pressure kPa</td><td>5.83</td><td>4</td><td>-1.83</td>" in text
    assert "Printed by a book; the pressure is the mean over the wall of the vein. It says no more." in text
    # (1 - 0.3)^-1.5: what the printed loss explains
    assert "a loss of 30 % raises SAWSS by 71 %, not by 205 %" in text
    # the fake's area is linear in the pressure on the skin
    assert re.search(r"fake, linear</td><td>skin</td>.*?<td>0.000</td><td>0.000</td>", text)
    # nothing is fetched: no address is loaded by the page itself
    assert not re.search(r"(src|href)\s*=", text)


def test_runs_without_steps_are_refused(tmp_path: Path) -> None:
    RunFolder.create(tmp_path / "empty", CASE)
    with pytest.raises(OutputError, match="holds no step yet"):
        report([tmp_path / "empty"], tmp_path / "report.html")


@pytest.mark.skipif(not any(map(shutil.which, BROWSERS)), reason=f"no browser is installed: {', '.join(BROWSERS)}")
def test_figures(stored: StoredRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each chart has the width asked for, its title and the units of its axes; those in 3-D are not blank."""
    few = [chart for chart in report_module.CHARTS if chart.title in ("Area of the lumen", "Vein in 3-D")]
    monkeypatch.setattr(report_module, "CHARTS", few)
    files = {path.name: path for path in figures([stored.path], tmp_path / "figures", 0.085)}
    kinds = {f"area_of_the_lumen.{kind}" for kind in ("svg", "pdf", "png")}
    assert set(files) == {*kinds, "vein_in_3_d__fake.png"}
    # 85 mm, as PDF in points, as SVG in pixels of CSS, as PNG with 300 dots in an inch
    box = re.search(rb"MediaBox \[0 0 ([\d.]+) ", files["area_of_the_lumen.pdf"].read_bytes())
    assert box
    assert float(box[1]) / 72 * 25.4 == pytest.approx(85, rel=2e-3, abs=0)
    for name in ("area_of_the_lumen.png", "vein_in_3_d__fake.png"):
        assert PIL.Image.open(files[name]).width / 300 * 25.4 == pytest.approx(85, rel=2e-3, abs=0)
    drawing = files["area_of_the_lumen.svg"].read_text(encoding="utf-8")
    wide = re.search(r'<svg[^>]* width="([\d.]+)"', drawing)
    assert wide
    assert float(wide[1]) / 96 * 25.4 == pytest.approx(85, rel=2e-3, abs=0)
    for text in ("Area of the lumen", "time [s]", "mean area [% of t = 0]"):
        assert f">{text}</text>" in drawing
    picture = np.asarray(PIL.Image.open(files["vein_in_3_d__fake.png"]).convert("RGB"))
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 500


@pytest.mark.skipif(not any(map(shutil.which, BROWSERS)), reason=f"no browser is installed: {', '.join(BROWSERS)}")
def test_in_a_browser(page: Path, tmp_path: Path) -> None:
    """It opens without an error, and every chart draws, those in 3-D too."""
    text = page.read_text(encoding="utf-8")
    probe = text.replace("<head>", f"<head>{LISTEN}", 1).replace("</body>", f"{LOOK}</body>", 1)
    found = _looked(probe.encode(), next(path for name in BROWSERS if (path := shutil.which(name))), tmp_path)
    assert found["failures"] == []
    in_3d = {name: count for name, count in found["colours"].items() if "in_3" in name}
    assert len(in_3d) == 4
    assert min(in_3d.values()) > 100, in_3d
    assert len(found["colours"]) == 18
    assert min(found["colours"].values()) > 5, found["colours"]


def _looked(page: bytes, browser: str, profile: Path) -> dict[str, Any]:
    """Serve a page to a headless browser and return what the page posts back."""
    answers: Queue[bytes] = Queue()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200 if self.path == "/" else 204)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.end_headers()
            if self.path == "/":
                self.wfile.write(page)

        def do_POST(self) -> None:
            answers.put(self.rfile.read(int(self.headers["Content-Length"])))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    flags = ["--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
             "--disable-dev-shm-usage", f"--user-data-dir={profile}", "--remote-debugging-port=0"]  # fmt: skip
    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_address[1]}/"
        child = subprocess.Popen([browser, *flags, address], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            answer: dict[str, Any] = json.loads(answers.get(timeout=PATIENCE))
        finally:
            child.terminate()
            child.wait()
            server.shutdown()
    return answer
