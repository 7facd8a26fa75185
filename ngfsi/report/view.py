"""A local page on which stored runs are looked at: time, quantity, planes of cut, the history of a place.

Served by trame (VTK draws, the browser shows), which is an extra: `pip install 'ngfsi[view]'`.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from ngfsi.arrays import Array
from ngfsi.errors import OutputError
from ngfsi.store.stored import StoredRun, Which, open_run
from ngfsi.units import Shown, symbol, unit_of

PLACES: dict[str, Which] = {"solids and blood": "volume", "inner wall": "wall"}
CUTS = {"not cut": None, "across x": "x", "across y": "y", "across z": "z"}
COLOURS = "viridis"
SPOT = "#d55e00"


class Viewer:
    """What is shown of one run, or of several side by side.

    Attributes:
        runs: with fields, each in a picture of its own.
        times: s, of the fields of the first.
        plotter: the scene.
    """

    def __init__(self, runs: Sequence[StoredRun]) -> None:
        """Prepare.

        Raises:
            OutputError: a run has no fields yet.
        """
        for run in runs:
            if not run.field_times():
                raise OutputError(f"the run in '{run.path}' holds no fields yet: nothing can be looked at")
        self.runs, self.times = list(runs), runs[0].field_times()
        self.plotter = pv.Plotter(shape=(1, len(runs)), off_screen=True, border=False)
        self.place, self.quantity, self.cut, self.at = "inner wall", "", "not cut", 0.5
        self.time = self.times[-1]
        self.picked: Array | None = None
        self._known: dict[tuple[int, Which, float], Any] = {}

    def quantities(self) -> list[str]:
        """Return the arrays at points of the place that is shown, those of forces on the wall first."""
        names = list(self._mesh(0, self.time).point_data)
        return sorted(names, key=lambda name: (not name.startswith("wall_shear_mag"), name))

    def draw(self) -> None:
        """Draw the scene anew."""
        names = self.quantities()
        if self.quantity not in names:
            self.quantity = names[0]
        shown = [self._cut(self._mesh(number, self.time)) for number in range(len(self.runs))]
        values = np.concatenate([mesh.point_data[self.quantity].reshape(mesh.n_points, -1) for mesh in shown])
        sizes = values[:, 0] if values.shape[1] == 1 else np.linalg.norm(values, axis=1)
        limits = (float(sizes.min()), float(sizes.max())) if len(sizes) else (0.0, 1.0)
        unit = unit_of(self.quantity)
        title = f"{self.quantity.removesuffix(f'_{unit}').replace('_', ' ')} [{symbol(unit)}]"
        for number, mesh in enumerate(shown):
            self.plotter.subplot(0, number)
            self.plotter.add_mesh(
                mesh, name=f"run {number}", scalars=self.quantity, cmap=COLOURS, clim=limits, copy_mesh=True,
                show_scalar_bar=not number, scalar_bar_args={"title": title}, render=False, reset_camera=False,
            )  # fmt: skip
            self.plotter.add_text(
                f"{self.runs[number].case.name}, {self.time:.3g} s", font_size=10, name=f"title {number}"
            )
            if self.picked is not None:
                near = mesh.points[mesh.find_closest_point(self.picked)]
                self.plotter.add_points(near[None], color=SPOT, point_size=14, name=f"spot {number}", render=False,
                                        render_points_as_spheres=True, reset_camera=False)  # fmt: skip
        self.plotter.link_views()

    def history(self, place: Array) -> list[tuple[Array, Array]]:
        """Return times (s) and values of the quantity at the material point nearest to a place (3,) [m], by run."""
        found = []
        for number, run in enumerate(self.runs):
            times, point = run.field_times(), self._mesh(number, self.time).find_closest_point(place)
            rows = np.array([self._mesh(number, time).point_data[self.quantity][point] for time in times])
            found.append((np.array(times), rows if rows.ndim == 1 else np.linalg.norm(rows, axis=1)))
        return found

    def chart(self) -> str:
        """Return the history of the picked place as a picture in an address (data:image/svg+xml)."""
        from matplotlib.figure import Figure

        if self.picked is None:
            return ""
        figure = Figure(figsize=(5, 2.4), layout="constrained")
        axes = figure.subplots()
        for run, (times, values) in zip(self.runs, self.history(self.picked), strict=True):
            axes.plot(times, values, ".-", label=run.case.name)
        axes.axvline(self.time, color="0.7")
        axes.set(xlabel=Shown("time", "s").label, ylabel=f"[{symbol(unit_of(self.quantity))}]", title=self.quantity)
        axes.legend()
        file = io.BytesIO()
        figure.savefig(file, format="svg")
        return f"data:image/svg+xml;base64,{base64.b64encode(file.getvalue()).decode()}"

    def _mesh(self, number: int, time: float) -> Any:
        which = PLACES[self.place]
        key = (number, which, time)
        if key not in self._known:
            self._known[key] = self.runs[number].fields(time, which)
        return self._known[key]

    def _cut(self, mesh: Any) -> Any:
        normal = CUTS[self.cut]
        if normal is None:
            return mesh
        axis = "xyz".index(normal)
        low, high = mesh.bounds[2 * axis], mesh.bounds[2 * axis + 1]
        origin = list(mesh.center)
        origin[axis] = low + self.at * (high - low)
        return mesh.clip(normal, origin=origin)


def serve(folders: Sequence[Path], port: int, browser: bool) -> None:
    """Show runs on a local page until the process is stopped.

    Raises:
        OutputError: a folder holds no run with fields, or trame is not installed.
    """
    runs = [open_run(folder) for folder in folders]
    try:
        from trame.app import get_server
        from trame.ui.vuetify3 import SinglePageLayout
        from trame.widgets import html, vuetify3
        from trame_pyvista import ui
    except ImportError as error:
        raise OutputError(
            f"the viewer needs trame ({error}): pip install 'ngfsi[view]', or make a page without a server by "
            f"`ngfsi report {' '.join(map(str, folders))}`"
        ) from None
    viewer = Viewer(runs)
    viewer.draw()
    viewer.plotter.reset_camera()
    server = get_server(client_type="vue3")
    state, controller = server.state, server.controller
    state.trame__title = "ngfsi"
    state.update({
        "step": len(viewer.times) - 1, "place": viewer.place, "quantity": viewer.quantity, "cut": viewer.cut,
        "at": viewer.at, "quantities": viewer.quantities(), "history": "",
    })  # fmt: skip

    def show(**_: Any) -> None:
        viewer.time, viewer.place, viewer.cut = viewer.times[int(state.step)], state.place, state.cut
        viewer.quantity, viewer.at = state.quantity, float(state.at)
        viewer.draw()
        state.quantities, state.quantity, state.history = viewer.quantities(), viewer.quantity, viewer.chart()
        state.shown = f"{viewer.time:.4g} s"
        controller.view_update()

    state.change("step", "place", "quantity", "cut", "at")(show)

    def pick(place: Any) -> None:
        viewer.picked = np.asarray(place)
        with state:  # which is not told of changes from outside its own events else
            show()

    viewer.plotter.enable_surface_point_picking(pick, show_message=False, show_point=False, left_clicking=True)
    with SinglePageLayout(server) as layout:
        layout.title.hide()
        layout.icon.hide()
        with layout.toolbar:
            select = {"density": "compact", "hide_details": True, "style": "max-width: 15em"}
            vuetify3.VSlider(
                v_model=("step",),
                min=0,
                max=len(viewer.times) - 1,
                step=1,
                hide_details=True,
                label="time",
                style="min-width: 12em",
            )
            html.Span("{{ shown }}", classes="mx-2")
            vuetify3.VSelect(v_model=("place",), items=("places", list(PLACES)), **select)
            vuetify3.VSelect(v_model=("quantity",), items=("quantities",), **select)
            vuetify3.VSelect(v_model=("cut",), items=("cuts", list(CUTS)), **select)
            vuetify3.VSlider(
                v_model=("at",), min=0.0, max=1.0, step=0.02, hide_details=True, style="min-width: 8em; max-width: 10em"
            )
        with layout.content, vuetify3.VContainer(fluid=True, classes="fill-height pa-0"):
            scene: Any = ui.plotter_ui
            view = scene(viewer.plotter, mode="server")
            controller.view_update = view.update
            html.Img(
                src=("history",),
                v_if=("history",),
                style="position: absolute; right: 1em; bottom: 1em; max-width: 45%; background: white",
            )
    server.start(port=port, open_browser=browser, show_connection_info=True, timeout=0)
