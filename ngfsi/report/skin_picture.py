"""A picture of pressures on the skin of a leg, from the side that is pressed most and from the opposite one."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import ngsolve as ng
import numpy as np
import pyvista as pv
from matplotlib import image

from ngfsi.mesh.domain import Domain
from ngfsi.report.render import BLOOD, WIDTH, drawn, plotter_of, say_that_opengl_works

PRESSURE, KIND = "pressure", "kind"
SKIN, REST, OPENING = range(3)
COLOURS, TISSUE = "cividis", "#e6d3bd"
HALVINGS = 3
"""Of the sides of elements, which are curved."""
ABOVE = 0.45
"""Height of the eye over its distance from the axis."""


def skin_picture(domain: Domain, skin: str, pressure: Any, high: float, path: Path) -> str:
    """Draw a pressure on the skin of a segment along z: two views beside each other, the ends of vessels red.

    Args:
        skin: boundary.
        pressure: on it, a coefficient function.
        high: pressure of the highest colour; the lowest is 0.
        path: PNG to write.

    Returns:
        Why there is no picture; empty when there is one.
    """
    openings = [name for vessel in domain.vessels for name in vessel.openings]
    kinds = {name: OPENING for name in openings} | {skin: SKIN}
    kind = domain.mesh.BoundaryCF({name: kinds.get(name, REST) for name in domain.mesh.GetBoundaries()})
    with tempfile.TemporaryDirectory(prefix="ngfsi-render-") as scratch:
        file = str(Path(scratch) / "skin")
        ng.VTKOutput(domain.mesh, coefs=[pressure, kind], names=[PRESSURE, KIND], filename=file, subdivision=HALVINGS,
                     legacy=False).Do(vb=ng.BND)  # fmt: skip
        return drawn("ngfsi.report.skin_picture:main", [f"{file}.vtu", high, str(path)], path)


def main(file: str) -> None:
    """Child process: draw the requested picture."""
    source, high, path = json.loads(Path(file).read_text(encoding="utf-8"))
    say_that_opengl_works()
    surfaces = pv.read(source)
    kinds = surfaces.point_data_to_cell_data()[KIND].round()
    parts = {kind: surfaces.extract_cells(np.flatnonzero(kinds == kind)) for kind in (SKIN, REST, OPENING)}
    skin = parts[SKIN]
    towards = skin[PRESSURE] @ (skin.points - skin.center)[:, :2]
    towards = towards / (np.linalg.norm(towards) or 1.0)
    views = []
    for side in (towards, -towards):
        plotter = plotter_of(WIDTH // 2, WIDTH // 2)
        plotter.add_mesh(skin, scalars=PRESSURE, clim=(0.0, high), cmap=COLOURS, show_scalar_bar=False, ambient=0.6,
                         diffuse=0.4)  # fmt: skip
        for kind, colour in ((REST, TISSUE), (OPENING, BLOOD)):
            if parts[kind].n_cells:
                plotter.add_mesh(parts[kind], color=colour, ambient=0.5, diffuse=0.5)
        plotter.view_vector([*side, ABOVE], viewup=(0, 0, 1))
        plotter.camera.zoom(1.2)
        views.append(plotter.screenshot(return_img=True))
    image.imsave(path, np.hstack(views))
