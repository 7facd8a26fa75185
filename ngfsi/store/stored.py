"""StoredRun: reads the folder of a run, also while it is computed and after it failed."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ngfsi.case import Case
from ngfsi.errors import OutputError
from ngfsi.measure.shear_history import ShearHistory, slope
from ngfsi.store.disk import explained
from ngfsi.store.folder import CASE, COSTS, MANIFEST, OUTLINES, SERIES, SHAPE, STABILITY
from ngfsi.store.table import read_table

SAME_TIME = 1e-9
"""Seconds."""

Which = Literal["volume", "wall"]
Columns = dict[str, NDArray[np.float64]]


@dataclass(frozen=True)
class StoredRun:
    """A run on the disk; what it holds is read when first asked for."""

    path: Path
    manifest: dict[str, Any]

    @property
    def status(self) -> str:
        """How the run ended: completed, failed, interrupted; "running" also if its process was killed."""
        return str(self.manifest["status"])

    @cached_property
    def case(self) -> Case:
        """The resolved case."""
        return Case.from_toml(self.path / CASE)

    @cached_property
    def series(self) -> Columns:
        """Quantities over time by column, e.g. `series["lumen_volume_m3"]`; empty before the first step."""
        return read_table(self.path / SERIES)

    @cached_property
    def costs(self) -> Columns:
        """Effort of each step by column."""
        return read_table(self.path / COSTS)

    @cached_property
    def shape(self) -> Columns:
        """Shape of the lumen in cross-sections by column, a row per written time and station."""
        return read_table(self.path / SHAPE)

    @cached_property
    def stability(self) -> Columns:
        """Smallest eigenvalue and critical pressure by column, a row per written time; empty if not asked for."""
        return read_table(self.path / STABILITY)

    @cached_property
    def _outlines(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        table = read_table(self.path / OUTLINES)
        if not table:
            raise OutputError(f"the run in '{self.path}' holds no cross-sections yet")
        stations, points = (int(table[name].max()) + 1 for name in ("station", "point"))
        whole = len(table["time_s"]) // (stations * points) * stations * points
        rings = np.column_stack([table[name][:whole] for name in ("x_m", "y_m", "z_m")])
        return table["time_s"][: whole : stations * points], rings.reshape(-1, stations, points, 3)

    def outlines(self, time: float) -> tuple[float, NDArray[np.float64]]:
        """Return the stored time [s] nearest to `time` and the cross-sections then, (stations, points, 3) [m]."""
        times, rings = self._outlines
        nearest = int(np.argmin(abs(times - time)))
        return float(times[nearest]), rings[nearest]

    def field_times(self, which: Which = "volume") -> list[float]:
        """Return the times [s] at which fields are stored."""
        return [] if (reader := self._fields(which)) is None else list(reader.time_values)

    def fields(self, time: float, which: Which = "volume") -> Any:
        """Return the fields nearest to `time` [s] as a pyvista mesh, its points deformed.

        Args:
            which: "volume" for the whole domain, "wall" for the inner surface of the vein.

        Raises:
            OutputError: no fields are stored.
        """
        reader = self._fields(which)
        if reader is None or not reader.time_values:
            raise OutputError(f"the run in '{self.path}' holds no fields of the {which} yet")
        reader.set_active_time_value(min(reader.time_values, key=lambda stored: abs(stored - time)))
        return reader.read()[0]

    def wall_history(self, start: float = 0.0, end: float = float("inf")) -> Any:
        """Return the wall's inner surface with averages over a time, as a pyvista mesh.

        Point fields are `TAWSS_Pa`, `OSI_1` and `RRT_1_Pa` (see `ShearHistory`), at material points, and
        `TAWSSG_Pa_m`, how fast TAWSS changes along the wall (the spatial gradient of DePaola et al., Arterioscler
        Thromb 12, 1992, of the average over time; Pa/m). The shape is that at the last time.

        Args:
            start, end: s, e.g. of the last period; the stored times between them count.

        Raises:
            OutputError: fewer than two states of the wall are stored then.
        """
        times = [time for time in self.field_times("wall") if start - SAME_TIME <= time <= end + SAME_TIME]
        if len(times) < 2:
            raise OutputError(
                f"the run in '{self.path}' holds {len(times)} states of the wall from {start:g} to {end:g} s: averages "
                "need two or more"
            )
        shear = []
        for time in times:
            wall = self.fields(time, "wall")
            parts = [wall.point_data[f"wall_shear_{way}_Pa"] for way in ("axial", "circumferential")]
            shear.append(np.stack(parts, axis=1).astype(float))
        found = ShearHistory.of(np.array(times), np.array(shear))
        wall.clear_data()
        for name, values in (("TAWSS_Pa", found.tawss), ("OSI_1", found.osi), ("RRT_1_Pa", found.rrt)):
            wall.point_data[name] = values
        wall.point_data["TAWSSG_Pa_m"] = slope(wall, "TAWSS_Pa")
        return wall

    def _fields(self, which: Which) -> Any:
        import pyvista  # takes a second to import, which reading a series need not wait for

        path = self.path / f"{which}.pvd"
        return pyvista.get_reader(str(path)) if path.exists() else None


def check_folder(folder: Path) -> None:
    """Refuse what cannot hold a run.

    Raises:
        OutputError: there is no such folder.
    """
    if not folder.is_dir():
        what = f"'{folder}' is no folder" if folder.exists() else f"the folder '{folder}' does not exist"
        raise OutputError(f"{what}: name the folder of a run, e.g. runs/calf")


def open_run(path: Path | str) -> StoredRun:
    """Return the run in a folder.

    Raises:
        OutputError: there is no run in the folder.
    """
    folder = Path(path)
    check_folder(folder)
    if not (folder / MANIFEST).exists() or not (folder / CASE).exists():
        raise OutputError(f"the folder '{folder}' holds no run: {MANIFEST} and {CASE} are expected in it")
    with explained(folder / MANIFEST, "read"):
        text = (folder / MANIFEST).read_text(encoding="utf-8")
    try:
        manifest = json.loads(text)
        known = manifest["status"]
    except (ValueError, KeyError, TypeError):
        raise OutputError(f"'{folder / MANIFEST}' is not the manifest of a run") from None
    return StoredRun(folder, {**manifest, "status": known})
