"""StoredRun: reads the folder of a run, also while it is computed and after it failed."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Self
from zipfile import BadZipFile

import numpy as np

from ngfsi.arrays import Array, Mask, Numbers
from ngfsi.case import Case
from ngfsi.errors import OutputError
from ngfsi.measure.shear_history import ShearHistory, slope, within
from ngfsi.store.disk import explained
from ngfsi.store.folder import CASE, END, ERRORS, MANIFEST, MESH
from ngfsi.store.table import read_rows, read_table
from ngfsi.store.vessels import StoredVessel
from ngfsi.units import SAME_TIME

SAME_LOAD = 1e-9
"""Relative difference of loads that is rounding."""
EVEN = 1e-3
"""Relative difference of the largest pressure on the skin from its mean from which it is not even."""
COMMON = ("time_", "step_", "skin_", "displacement_", "detF_")
"""Beginnings of columns that are of no single vessel."""

Which = Literal["volume", "wall"]
Columns = dict[str, Array]


@dataclass(frozen=True)
class StoredRun:
    """A run on the disk; what it holds is read when first asked for.

    Attributes:
        vessel: of which columns, cross-sections and walls are those without a name; None: the whole run.
        branch: along which of the vessel's centrelines columns and cross-sections are those without a name: that to, or
            from, the opening of that name; empty: the first.
    """

    path: Path
    manifest: dict[str, Any]
    vessel: str | None = None
    branch: str = ""

    def of_vessel(self, name: str) -> Self:
        """Return the run as if it were that of one of its vessels alone, whose columns lose their name."""
        return replace(self, vessel=name)

    def of_branch(self, name: str) -> Self:
        """Return the run as if of one further centreline of the vessel alone: its columns along it lose the name, and
        there are no others of the vessel."""
        return replace(self, branch=name)

    @property
    def status(self) -> str:
        """How the run ended: completed, failed, interrupted; "running" also if its process was killed."""
        return str(self.manifest["status"])

    @cached_property
    def case(self) -> Case:
        """The resolved case."""
        return Case.from_toml(self.path / CASE)

    def _table(self, name: str) -> Columns:
        return read_table(self.path / f"{name}.csv")

    @cached_property
    def vessels(self) -> dict[str, StoredVessel]:
        """The vessels by name; the first one has none."""
        given = self.manifest.get("vessels")
        if given is None:
            return {vessel.name: StoredVessel(**vars(vessel)) for vessel in self.case.geometry.vessels}
        return {name: StoredVessel.of_entry(name, entry) for name, entry in given.items()}

    @property
    def own_vessel(self) -> StoredVessel:
        """The vessel that is looked at, or the first one.

        Raises:
            OutputError: there is none, or no such branch of it.
        """
        if not self.vessels:
            raise OutputError(f"the run in '{self.path}' is of no vessel")
        return self._whole_vessel.of_branch(self.branch) if self.branch else self._whole_vessel

    @property
    def _whole_vessel(self) -> StoredVessel:
        return self.vessels[self.vessel or next(iter(self.vessels))]

    @property
    def lumens(self) -> set[str]:
        """Names of the regions of blood."""
        return {vessel.lumen for vessel in self.case.geometry.vessels if vessel.lumen}

    @cached_property
    def skin_pressure(self) -> Array | None:
        """Pressure on the skin over time, mean over its area with all cuffs, Pa; None: there is none."""
        found = self.series.get("skin_pressure_mean_Pa", self.series.get("skin_pressure_Pa"))
        return found if found is not None and np.any(found) else None

    def on_skin(self, time: float) -> list[float]:
        """Return the pressure on the skin at a time (s), cuffs included (Pa): mean over its area and, where that is
        less, its largest value; nothing: there is none."""
        if self.skin_pressure is None:
            return []
        pressures = self.skin_pressure, self.series.get("skin_pressure_max_Pa", self.skin_pressure)
        mean, most = (float(np.interp(time, self.series["time_s"], one)) for one in pressures)
        return [mean, most] if most - mean > EVEN * abs(mean) else [mean]

    @property
    def _loaded_rows(self) -> Numbers:
        """Rows of the series in which the load is at its largest: the size of the pressure on the skin, or else, of
        solids alone, their displacement; all rows if that never changes."""
        load = self.skin_pressure
        if load is None and not self.lumens:
            load = self.series.get("displacement_max_m")
        size = np.zeros(len(self.series["time_s"])) if load is None else np.abs(load)
        return np.flatnonzero(size >= (1 - SAME_LOAD) * size.max())

    @property
    def loaded_row(self) -> int:
        """Row of the series in which the load, see `loaded_time`, is first at its largest; the last if it never
        changes."""
        rows, last = self._loaded_rows, len(self.series["time_s"]) - 1
        return last if len(rows) > last else int(rows[0])

    @property
    def loaded_time(self) -> float:
        """Last time (s) at which the load is at its largest: the pressure on the skin, cuffs included, or, of solids
        alone without such, their displacement; the end where there is no load that changes."""
        return float(self.series["time_s"][self._loaded_rows[-1]])

    def along(self, name: str, unit: str) -> Array:
        """Return a quantity of the series at each station along the vessel over time, (times, stations).

        Raises:
            OutputError: the run does not hold it.
        """
        columns = sorted(c for c in self.series if c.startswith(f"{name}_z") and c.endswith(f"_{unit}"))
        if not columns:
            raise OutputError(f"the run in '{self.path}' holds no {name}_z00_{unit}: compute it again")
        return np.column_stack([self.series[column] for column in columns])

    @cached_property
    def series(self) -> Columns:
        """Quantities over time by column, e.g. `series["lumen_volume_m3"]`; empty before the first step."""
        table = self._table("series")
        if not self.vessel and not self.branch:
            return table
        begin = f"{self.vessel}_" if self.vessel else ""
        own = {name.removeprefix(begin): column for name, column in table.items() if name.startswith(begin)}
        if self.branch:
            middle = f"_{self.branch}_z"
            own = {name.replace(middle, "_z"): column for name, column in own.items() if middle in name}
        return {name: column for name, column in table.items() if name.startswith(COMMON)} | own

    @cached_property
    def costs(self) -> Columns:
        """Effort of each step by column."""
        return self._table("costs")

    @cached_property
    def shape(self) -> Columns:
        """Shape of the lumen in cross-sections by column, a row per written time and station."""
        return self._of_vessel(self._table("shape"))

    @cached_property
    def stability(self) -> Columns:
        """Smallest eigenvalue and critical pressure by column, a row per written time; empty if not asked for."""
        return self._table("stability")

    @cached_property
    def errors(self) -> list[dict[str, float | str]]:
        """Rows of the estimated errors (see run/estimate.py); none if they were not asked for."""
        return read_rows(self.path / ERRORS)

    def end(self, mesh: str) -> dict[str, Array]:
        """Return the state at the end, that of a system on the mesh of a fingerprint.

        Raises:
            OutputError: it is not stored, or of another mesh.
        """
        try:
            with explained(self.path / END, "read"), np.load(self.path / END, allow_pickle=False) as stored:
                found = dict(stored)
            own = str(found.pop(MESH))
        except (ValueError, KeyError, BadZipFile):
            raise OutputError(f"'{self.path / END}' is not as it was written: compute the run again") from None
        if own != mesh:
            raise OutputError(f"the run in '{self.path}' is of another mesh than that of its case: compute it again")
        return found

    @cached_property
    def _outlines(self) -> Columns:
        return self._of_vessel(self._table("outlines"))

    def _of_vessel(self, table: Columns) -> Columns:
        if "vessel" in table:
            table = _chosen(table, table["vessel"] == self._number)
        if "branch" in table:
            table = _chosen(table, table["branch"] == self._branch_number)
        return table

    def outlines(self, time: float) -> tuple[float, Array]:
        """Return the stored time [s] nearest to `time` and the vessel's cross-sections then, (stations, points, 3) [m].

        Raises:
            OutputError: none are stored.
        """
        table = self._outlines
        if not table or not len(table["time_s"]):
            raise OutputError(f"the run in '{self.path}' holds no cross-sections yet")
        shape = int(table["station"].max()) + 1, int(table["point"].max()) + 1
        size = shape[0] * shape[1]
        whole = len(table["time_s"]) // size * size
        times = table["time_s"][:whole:size]
        nearest = int(np.argmin(abs(times - time)))
        rows = slice(nearest * size, (nearest + 1) * size)
        rings = np.column_stack([table[name][rows] for name in ("x_m", "y_m", "z_m")]).reshape(*shape, 3)
        return float(times[nearest]), rings

    def field_times(self, which: Which = "volume") -> list[float]:
        """Return the times [s] at which fields are stored."""
        return [] if (reader := self._fields(which)) is None else list(reader.time_values)

    def fields(self, time: float, which: Which = "volume") -> Any:
        """Return the fields of volume or inner walls nearest to `time` [s] as a pyvista mesh, its points deformed.

        Raises:
            OutputError: no fields are stored.
        """
        reader = self._fields(which)
        if reader is None or not reader.time_values:
            raise OutputError(f"the run in '{self.path}' holds no fields of the {which} yet")
        reader.set_active_time_value(min(reader.time_values, key=lambda stored: abs(stored - time)))
        found = reader.read()[0]
        if self.vessel is None or "vessel" not in found.cell_data:
            return found
        return found.extract_cells(np.flatnonzero(found.cell_data["vessel"] == self._number))

    @property
    def _number(self) -> int:
        """Of the vessel, as in the fields of the walls and in outlines of several vessels."""
        return list(self.vessels).index(self.vessel or "")

    @property
    def _branch_number(self) -> int:
        """Of the centreline, as in outlines of branched vessels."""
        return ["", *self._whole_vessel.further].index(self.branch)

    def wall_history(self, start: float = 0.0, end: float = float("inf")) -> Any:
        """Return the wall's inner surface with averages over a time, as a pyvista mesh.

        Point fields are `TAWSS_Pa`, `OSI_1` and `RRT_1_Pa` (see `ShearHistory`), at material points, and
        `TAWSSG_Pa_m`, how fast TAWSS changes along the wall (the spatial gradient of DePaola et al., Arterioscler
        Thromb 12, 1992, of the average over time; Pa/m). The shape is that at the last time.

        Args:
            start, end: s, e.g. of the last period; default: the whole run. They need not be stored times, between
                which the stress goes by lines.

        Raises:
            OutputError: states of the wall are not stored from start to end.
        """
        times = np.array(self.field_times("wall"))
        last = times[-1] if len(times) else 0.0
        end = last if end == float("inf") else end
        if not (len(times) > 1 and times[0] - SAME_TIME <= start < end <= last + SAME_TIME):
            raise OutputError(
                f"the run in '{self.path}' holds {len(times)} states of the wall up to {last:g} s: averages from "
                f"{start:g} to {end:g} s need two or more around that time"
            )
        before, after = np.searchsorted(times, [start + SAME_TIME, end - SAME_TIME])
        times, shear = times[before - 1 : after + 1], []
        for time in times:
            wall = self.fields(time, "wall")
            parts = [wall.point_data[f"wall_shear_{way}_Pa"] for way in ("axial", "circumferential")]
            shear.append(np.stack(parts, axis=1).astype(float))
        found = ShearHistory.of(*within(times, np.array(shear), start, end))
        wall.clear_data()
        for name, values in (("TAWSS_Pa", found.tawss), ("OSI_1", found.osi), ("RRT_1_Pa", found.rrt)):
            wall.point_data[name] = values
        wall.point_data["TAWSSG_Pa_m"] = slope(wall, "TAWSS_Pa")
        return wall

    def _fields(self, which: Which) -> Any:
        import pyvista  # takes a second to import, which reading a series need not wait for

        path = self.path / f"{which}.pvd"
        return pyvista.get_reader(str(path)) if path.exists() else None


def _chosen(table: Columns, rows: Mask) -> Columns:
    return {name: column[rows] for name, column in table.items()}


def mean_over_steps(series: Columns, column: str) -> float:
    """Return the mean of a column over the time after t = 0, each value counting for the step that it ends: where a
    load starts with a jump of its rate, the value at t = 0 is of no time."""
    return float(np.average(series[column][1:], weights=np.diff(series["time_s"])))


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
    except ValueError:
        manifest = None
    if not isinstance(manifest, dict) or "status" not in manifest:
        raise OutputError(f"'{folder / MANIFEST}' is not the manifest of a run")
    return StoredRun(folder, manifest)
