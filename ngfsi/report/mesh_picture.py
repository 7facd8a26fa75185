"""A picture of a mesh before anything is computed: regions by colour, cut open along the vessel, openings by name."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path

import matplotlib
import numpy as np
import pyvista as pv
from matplotlib import pyplot as plt
from matplotlib.patches import Patch

from ngfsi.arrays import Array
from ngfsi.report.render import WIDTH, drawn, plotter_of, say_that_opengl_works
from ngfsi.store.export import BOUNDARY, Named, straight, write
from ngfsi.store.fields import REGION

COLOURS = {"fluid": "#b5322f", "wall": "#e0963a", "tissue": "#e6d3bd", "solid": "#e6d3bd"}
FURTHER = ("#6d8fb3", "#8aa66b", "#a98bb8", "#c9b24f", "#7f7f7f")


def mesh_picture(named: Named, openings: Mapping[str, tuple[float, ...]], path: Path) -> str:
    """Draw a mesh.

    Args:
        openings: name -> place [m] of its label.
        path: PNG to write.

    Returns:
        Why there is no picture; empty when there is one.
    """
    with tempfile.TemporaryDirectory(prefix="ngfsi-render-") as scratch:
        grid = Path(scratch) / "mesh.vtu"
        write(named._replace(mesh=straight(named.mesh)), grid, "vtu")
        request = [str(grid), named.regions, {name: list(place) for name, place in openings.items()}, str(path)]
        return drawn("ngfsi.report.mesh_picture:main", request, path)


def main(file: str) -> None:
    """Child process: draw the requested picture."""
    matplotlib.use("Agg")
    source, regions, openings, path = json.loads(Path(file).read_text(encoding="utf-8"))
    say_that_opengl_works()
    grid = pv.read(source)
    cells = grid.extract_cells(np.flatnonzero(grid.cell_data[BOUNDARY] < 0))
    further = iter(FURTHER * len(regions))
    colours = {name: COLOURS.get(name) or next(further) for name in regions}
    plane = not np.ptp(cells.bounds[4:])
    along, across = _axes(np.array(list(openings.values())).reshape(-1, 3), cells)
    plotter = plotter_of(WIDTH, WIDTH * 2 // 3)
    for number, name in enumerate(regions):
        part = cells.extract_cells(np.flatnonzero(cells.cell_data[REGION] == number))
        if not plane and len(regions) > 1 and number < len(regions) - 1:
            # whole cells beyond the middle: what lies outside does not hide what lies inside
            part = part.extract_cells(np.flatnonzero((part.cell_centers().points - cells.center) @ across < 0))
        if part.n_cells:
            plotter.add_mesh(part.extract_surface(algorithm="dataset_surface"), color=colours[name], show_edges=True,
                             line_width=0.5, ambient=0.45, diffuse=0.6)  # fmt: skip
    if openings:
        plotter.add_point_labels(np.array(list(openings.values())).reshape(-1, 3), list(openings), font_size=22,
                                 always_visible=True, shape_color="white", shape_opacity=0.8, text_color="black",
                                 point_size=12, point_color="black")  # fmt: skip
    if plane:
        plotter.view_xy()
    else:
        plotter.view_vector(across + 0.35 * along, viewup=np.cross(across, along))
    plotter.camera.zoom(1.35)
    _compose(plotter.screenshot(return_img=True), colours, cells.n_cells, Path(path))


def _axes(places: Array, cells: pv.UnstructuredGrid) -> tuple[Array, Array]:
    """Return the direction from the first opening to the second, or the longest of the mesh, and one across it, along
    which the mesh is thinnest."""
    points = np.asarray(cells.points) - np.mean(cells.points, axis=0)
    axes = np.linalg.svd(points, full_matrices=False)[2]
    along = places[1] - places[0] if len(places) > 1 else axes[0]
    along = along / np.linalg.norm(along)
    # the least of the mesh's axes that is not along the vessel
    across = min((axis for axis in axes if abs(axis @ along) < 0.9), key=lambda axis: float(np.ptp(points @ axis)))
    across = across - (across @ along) * along
    return along, across / np.linalg.norm(across)


def _compose(image: Array, colours: Mapping[str, str], count: int, path: Path) -> None:
    figure, axes = plt.subplots(figsize=(9.0, 6.4), layout="constrained")
    axes.imshow(image)
    axes.set_axis_off()
    axes.legend(handles=[Patch(color=colour, label=name) for name, colour in colours.items()], loc="lower left",
                ncols=len(colours), fontsize=11, frameon=False)  # fmt: skip
    cut = "; what lies before the middle of the vessel is cut away" if len(colours) > 1 else ""
    axes.set_title(f"{count:,} cells{cut}", fontsize=11, loc="left")
    figure.savefig(path, dpi=120)
    plt.close(figure)
