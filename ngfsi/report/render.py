"""Three-dimensional pictures of stored runs, drawn off-screen by pyvista.

A missing or broken OpenGL library may end the process that calls it; pictures are therefore drawn in a child process,
and a failure is reported in a sentence.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pyvista as pv
from imageio_ffmpeg import write_frames
from matplotlib import pyplot as plt
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from PIL import Image

from ngfsi import process
from ngfsi.report.shapes import FROM_BEHIND, MOVED, SHEAR, WSS, evenly, lower_half, middle
from ngfsi.store.disk import explained
from ngfsi.store.stored import StoredRun, open_run
from ngfsi.store.vessels import Frame
from ngfsi.units import Shown, in_unit, to_si

TIMEOUT = 180.0
NO_OPENGL = (
    "3-D pictures need OpenGL, which did not work here (on Debian or Ubuntu: apt-get install libegl1 libgl1 "
    "libgl1-mesa-dri): {}"
)
OPENGL_WORKS = "OpenGL works"
"""What the child says before it draws."""

FRAMES, FRAME_MS = 60, 80
"""Of an animation: at most so many, each shown so long."""
FLAT = 1.2
"""Ratio of height to depth, from the front, beyond which a vessel is looked at from the side."""
WIDTH = 1500
"""Pixels across a picture."""
BONE, BLOOD, COLOURS = "#efe6d2", "#b5322f", "viridis"
SHADED: dict[str, Any] = {
    "cmap": COLOURS, "ambient": 0.7, "diffuse": 0.3, "smooth_shading": True, "split_sharp_edges": True,
    "show_scalar_bar": False,
}  # fmt: skip
"""Mostly ambient light, since shades would be read as values."""


def displacement_picture(runs: Mapping[str, StoredRun], time: float, path: Path) -> str:
    """Draw the deformed solids at `time` [s], cut open to the vein and coloured by displacement, a panel per run.

    Returns:
        Why there is no picture; empty when there is one.
    """
    return _in_child("displacement", runs, [time], path)


def wall_shear_picture(runs: Mapping[str, StoredRun], times: Sequence[float], path: Path) -> str:
    """Draw the wall shear stress on the deformed vein at some times [s], one vein per run and time, to one scale.

    Returns:
        Why there is no picture; empty when there is one.
    """
    return _in_child("wall_shear", runs, times, path)


def animation(run: StoredRun, path: Path) -> str:
    """Draw the deforming vein with its wall shear stress as .gif or .mp4, a frame a stored wall, at most `FRAMES`.

    Returns:
        Why there is no animation; empty when there is one.
    """
    times = run.field_times("wall")
    if not times:
        lacks = (
            "holds no fields of the wall yet" if run.lumens else "is of no vessel with blood: there is no wall shear"
        )
        return f"the run in '{run.path}' {lacks}"
    return _in_child("animation", {run.case.name: run}, evenly(times, FRAMES), path)


def _in_child(kind: str, runs: Mapping[str, StoredRun], times: Sequence[float], path: Path) -> str:
    folders = {title: str(run.path) for title, run in runs.items()}
    return drawn("ngfsi.report.render:main", [kind, folders, list(times), str(path)], path)


def drawn(function: str, request: Any, path: Path) -> str:
    """Have a function of a module draw a picture in a child process, which first says that OpenGL works.

    Args:
        function: takes the name of a file with the request.
        request: for JSON.
        path: picture that the function writes.

    Returns:
        Why there is no picture; empty when there is one.
    """
    with explained(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)
    with tempfile.TemporaryDirectory(prefix="ngfsi-render-") as scratch:
        file = Path(scratch) / "request.json"
        file.write_text(json.dumps(request), encoding="utf-8")
        try:
            child = process.call(function, file, timeout=TIMEOUT)
        except subprocess.TimeoutExpired:
            return f"drawing the picture took longer than {TIMEOUT:g} s and was given up"
    if child.returncode == 0 and path.exists():
        return ""
    said = process.last_line(child.stderr, f"the process ended with code {child.returncode}")
    return f"the picture could not be drawn: {said}" if OPENGL_WORKS in child.stdout else NO_OPENGL.format(said)


def main(file: str) -> None:
    """Child process: draw the requested picture."""
    matplotlib.use("Agg")
    kind, folders, times, path = json.loads(Path(file).read_text(encoding="utf-8"))
    say_that_opengl_works()
    draw = {"displacement": _draw_displacement, "wall_shear": _draw_wall_shear, "animation": _draw_animation}
    draw[kind]({title: open_run(folder) for title, folder in folders.items()}, times, path)


def say_that_opengl_works() -> None:
    """Draw something small, and say so: a process that cannot ends here."""
    pv.Plotter(off_screen=True, window_size=(10, 10)).screenshot()
    print(OPENGL_WORKS, flush=True)


def _draw_displacement(runs: Mapping[str, StoredRun], times: Sequence[float], path: str) -> None:
    halves = {title: lower_half(run, times[0]) for title, run in runs.items()}
    limits = (0.0, max(float(solid["displacement"].max()) for solid in halves.values()))
    images = {}
    bones = {title: _bones(run) for title, run in runs.items()}
    walls = {title: run.fields(times[0], "wall") for title, run in runs.items() if run.field_times("wall")}
    for title, run in runs.items():
        plotter = plotter_of(WIDTH // 2, WIDTH // 2)
        plotter.add_mesh(halves[title], scalars="displacement", clim=limits, **SHADED)
        if title in walls:
            plotter.add_mesh(walls[title], color=BLOOD, smooth_shading=True)
        for bone in bones[title]:
            plotter.add_mesh(bone, color=BONE, smooth_shading=True, split_sharp_edges=True)
        axes = middle(run).axes
        plotter.view_vector(np.dot(FROM_BEHIND, axes), viewup=axes[2])
        plotter.reset_camera()
        plotter.camera.zoom(1.15)
        images[f"{title}, t = {in_unit(times[0], 's')}"] = plotter.screenshot(return_img=True)
    colours = ", ".join([*(["vein red"] if walls else []), *(["bones white"] if any(bones.values()) else [])])
    note = "\n".join(["upper half of the tissue cut away, seen from behind", *([colours] if colours else [])])
    _compose(images, path, columns=min(len(images), 3), limits=limits, shown=MOVED, note=note)


def _bones(run: StoredRun) -> list[Any]:
    """Return the rigid bones, which the mesh leaves out, standing out a little of the segment."""
    geometry = run.case.geometry
    return [
        pv.Cylinder((b.x, b.y, geometry.length / 2), (0, 0, 1), 0.995 * b.radius, 1.02 * geometry.length, resolution=60)
        for b in getattr(geometry, "bones", ())
    ]


def _draw_wall_shear(runs: Mapping[str, StoredRun], times: Sequence[float], path: str) -> None:
    frame = middle(next(iter(runs.values())))
    walls = {
        f"{title}, t = {in_unit(time, 's')}": run.fields(time, "wall").clean(tolerance=1e-7)
        for title, run in runs.items()
        for time in times
    }
    low, high = np.percentile(np.concatenate([wall[SHEAR] for wall in walls.values()]), [1, 99])
    sizes = np.max([np.ptp(wall.points @ frame.axes.T, axis=0) for wall in walls.values()], axis=0)
    width, length = float(sizes[0]), float(sizes[2])
    images = {}
    for title, wall in walls.items():
        plotter = plotter_of(WIDTH, round(WIDTH * width / length * 1.1))
        plotter.add_mesh(wall, scalars=SHEAR, clim=(low, high), **SHADED)
        _look_across(plotter, wall, frame, length)
        plotter.camera.parallel_scale = width * 0.52
        images[title] = plotter.screenshot(return_img=True)
    note = "deformed inner wall of the vein from the front, all to the same scale; blood flows from left to right"
    _compose(images, path, columns=1, limits=(low, high), shown=WSS, note=note)


def _look_across(plotter: Any, wall: Any, frame: Frame, distance: float, *, flat: bool = False) -> None:
    """Put the camera in front of a vessel that runs from left to right, angles counting from above; or, of a flat one,
    beside it, so that it is seen to close."""
    plotter.enable_parallel_projection()
    up, forwards = (frame.axes[1], -frame.axes[0]) if flat else frame.axes[:2]
    plotter.camera_position = [np.add(wall.center, distance * forwards), wall.center, up]


def _draw_animation(runs: Mapping[str, StoredRun], times: Sequence[float], path: str) -> None:
    (run,) = runs.values()
    walls = [run.fields(time, "wall").clean(tolerance=1e-7) for time in times]
    high = float(np.percentile(np.concatenate([wall[SHEAR] for wall in walls]), 99))
    start, frame = walls[0], middle(run)
    sizes = np.ptp(start.points @ frame.axes.T, axis=0)
    flat, length = bool(sizes[0] > FLAT * sizes[1]), float(sizes[2])
    width = float(sizes[1 if flat else 0])
    frames = []
    for time, wall in zip(times, walls, strict=True):
        plotter = plotter_of(WIDTH // 2, WIDTH // 6)
        bar = {"title": WSS.label, "color": "black", "position_y": 0.04, "height": 0.12, "n_labels": 3}
        plotter.add_mesh(wall, scalars=SHEAR, clim=(0.0, high), **SHADED | {"show_scalar_bar": True},
                         scalar_bar_args=bar)  # fmt: skip
        plotter.add_text(_caption(run, time), font_size=9, color="black")
        # the camera stands still, so that the vein is seen to move
        _look_across(plotter, start, frame, length, flat=flat)
        plotter.camera.parallel_scale = max(1.1 * width, 0.53 * length / 3)  # frames are three times as wide as high
        frames.append(Image.fromarray(plotter.screenshot(return_img=True)))
        plotter.close()
    _save_frames(frames, Path(path))


def _caption(run: StoredRun, time: float) -> str:
    """Return the time (s) and the pressure on the skin then, if there is one: its mean, and its largest value where
    cuffs make it differ."""
    words = "{} on the skin", "most {}"
    skin = (
        word.format(in_unit(pressure, "mmHg", ".1f")) for word, pressure in zip(words, run.on_skin(time), strict=False)
    )
    return ", ".join([f"t = {in_unit(time, 's', '.2f')}", *skin])


def _save_frames(frames: Sequence[Image.Image], path: Path) -> None:
    """Write pictures of one size as a film; of H.264, with the pixels that every player shows, if it is an MP4."""
    if path.suffix.lower() != ".mp4":
        frames[0].save(path, save_all=True, append_images=frames[1:], duration=FRAME_MS, loop=0)
        return
    film = write_frames(str(path), frames[0].size, fps=1 / to_si(FRAME_MS, "ms"), macro_block_size=2)
    film.send(None)
    for frame in frames:
        film.send(frame.convert("RGB").tobytes())
    film.close()


def plotter_of(width: int, height: int) -> Any:
    """Return a plotter off screen with a light at the eye."""
    plotter = pv.Plotter(off_screen=True, window_size=(width, height), lighting="none")
    plotter.add_light(pv.Light(light_type="headlight"))
    plotter.enable_anti_aliasing("ssaa")
    return plotter


def _compose(
    images: Mapping[str, Any], path: str, *, columns: int, limits: tuple[float, float], shown: Shown, note: str
) -> None:
    """Lay pictures out with their titles above and one colour bar below."""
    height, width = next(iter(images.values())).shape[:2]
    rows = -(-len(images) // columns)
    panel = 9.0 / columns
    size = (9.0, rows * (panel * height / width + 0.35) + 1.0)
    figure, panels = plt.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
    for axes in panels.flat:
        axes.set_axis_off()
    for axes, (title, image) in zip(panels.flat, images.items(), strict=False):
        axes.imshow(image)
        axes.set_title(title, fontsize=11, loc="left")
    scale = ScalarMappable(Normalize(shown(limits[0]), shown(limits[1])), COLOURS)
    bar = figure.colorbar(scale, ax=panels, location="bottom", shrink=0.6, aspect=40, pad=0.02)
    bar.set_label(f"{shown.label}\n{note}", fontsize=10)
    figure.savefig(path, dpi=150)
