"""Fields of a run for ParaView and pyvista: one .vtu file per time, and a .pvd file that lists the times.

Points are those of the deformed shape; the field `displacement_m` leads back to the reference shape. Volume cells are
curved, of second order whatever the order of the fields, and do not share points, so that fields may jump between
regions; the cell field `region` numbers the regions in the order of the field data `regions`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import ngsolve as ng
import numpy as np
import pyvista as pv

from ngfsi.domain import Domain
from ngfsi.measure.wall import WallSample
from ngfsi.output.table import explained

FOLDER = "fields"
DISPLACEMENT = "displacement_m"
REGION = "region"
STRESS, DEFORMATION = "stress_Pa", "deformation_gradient_1"
"""Tensors of the solids, of which the invariants are written: hydrostatic pressure -tr(sigma)/3, and principal stresses
and stretches, the largest first."""
CELL_ORDER = 2
"""Higher ones make files large without being seen, and hardly any program but ParaView reads them."""

MIRRORED = {
    pv.CellType.QUADRATIC_TETRA: [0, 2, 1, 3, 6, 5, 4, 7, 9, 8],
    pv.CellType.QUADRATIC_HEXAHEDRON: [4, 5, 6, 7, 0, 1, 2, 3, 12, 13, 14, 15, 8, 9, 10, 11, 16, 17, 18, 19],
    pv.CellType.BIQUADRATIC_QUADRATIC_WEDGE: [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8, 12, 13, 14, 15, 16, 17],
}
"""Order of the nodes that turns a cell of negative volume into the same cell of positive volume."""


class FieldWriter:
    """Writes the fields of a run into its folder."""

    def __init__(self, folder: Path, domain: Domain, volume_fields: dict[str, ng.CoefficientFunction]) -> None:
        """Prepare.

        Args:
            folder: folder of the run.
            domain: the reference shape.
            volume_fields: name with unit -> field on the whole domain; `displacement_m` must be among them.
        """
        if DISPLACEMENT not in volume_fields:
            raise ValueError(f"'{DISPLACEMENT}' must be among the fields: {sorted(volume_fields)}")
        self.folder = folder
        self._mesh, self._names, self._coefficients = domain.mesh, list(volume_fields), list(volume_fields.values())
        regions = list(domain.regions)
        self._regions = regions
        self._cell_regions = np.array([regions.index(e.mat) for e in domain.mesh.Elements(ng.VOL)], dtype=np.int32)
        self._times: dict[str, list[float]] = {"volume": [], "wall": []}

    def write(self, time: float) -> None:
        """Store the present fields as those of `time` [s].

        Raises:
            OutputError: the files cannot be written.
        """
        self._store("volume", time, self._volume)

    def write_wall(self, time: float, wall: WallSample) -> None:
        """Store the sampled wall as that of `time` [s].

        Raises:
            OutputError: the files cannot be written.
        """
        self._store("wall", time, lambda: wall_grid(wall))

    def _store(self, name: str, time: float, make: Callable[[], pv.UnstructuredGrid]) -> None:
        times = self._times[name]
        times.append(time)
        with explained(self.folder / FOLDER):
            (self.folder / FOLDER).mkdir(exist_ok=True)
            self._save(make(), self.folder / FOLDER / f"{name}_{len(times) - 1:04d}.vtu")
            write_index(self.folder / f"{name}.pvd", f"{FOLDER}/{name}_{{:04d}}.vtu", times)

    def _volume(self) -> pv.UnstructuredGrid:
        raw = self.folder / FOLDER / "unfinished"
        ng.VTKOutput(
            self._mesh,
            coefs=self._coefficients,
            names=self._names,
            filename=str(raw),
            order=CELL_ORDER,
            floatsize="single",
        ).Do()
        written = raw.with_suffix(".vtu")
        grid = pv.read(written)
        written.unlink()
        _orient(grid)
        grid.points += grid.point_data[DISPLACEMENT]
        _take_invariants(grid)
        grid.cell_data[REGION] = self._cell_regions
        grid.field_data["regions"] = self._regions
        return grid

    @staticmethod
    def _save(grid: pv.UnstructuredGrid, path: Path) -> None:
        partial = path.with_name(f"part-{path.name}")
        grid.save(partial)
        partial.replace(path)


def _orient(grid: pv.UnstructuredGrid) -> None:
    """Renumber the nodes of cells that NGSolve wrote with negative volume: its tetrahedra turn the other way."""
    negative = grid.compute_cell_sizes()["Volume"] < 0
    nodes = grid.cell_connectivity
    for kind, order in MIRRORED.items():
        first = grid.cell_offsets[:-1][negative & (grid.celltypes == kind)]
        nodes[first[:, None] + np.arange(len(order))] = nodes[first[:, None] + order]


def _take_invariants(grid: pv.UnstructuredGrid) -> None:
    """Replace the tensors of the solids, if there are any, by what people look at."""
    if STRESS in grid.point_data:
        stress = np.asarray(grid.point_data.pop(STRESS)).reshape(-1, 3, 3)
        grid.point_data["hydrostatic_pressure_Pa"] = -np.trace(stress, axis1=1, axis2=2) / 3
        grid.point_data["principal_stresses_Pa"] = np.linalg.eigvalsh(stress)[:, ::-1]
    if DEFORMATION in grid.point_data:
        gradient = np.asarray(grid.point_data.pop(DEFORMATION)).reshape(-1, 3, 3)
        grid.point_data["principal_stretches_1"] = np.linalg.svd(gradient, compute_uv=False)


def wall_grid(wall: WallSample) -> pv.UnstructuredGrid:
    """Return the sampled wall as linear quadrilaterals with wall shear stress and pressure."""
    quads = np.column_stack([np.full(len(wall.quads), 4), wall.quads])
    types = np.full(len(wall.quads), pv.CellType.QUAD)
    grid = pv.UnstructuredGrid(quads.ravel(), types, wall.points.astype(np.float32))
    grid.point_data["wall_shear_Pa"] = wall.shear.astype(np.float32)
    grid.point_data["wall_shear_axial_Pa"] = wall.tangential[:, 0].astype(np.float32)
    grid.point_data["wall_shear_circumferential_Pa"] = wall.tangential[:, 1].astype(np.float32)
    grid.point_data["wall_shear_magnitude_Pa"] = np.linalg.norm(wall.shear, axis=1).astype(np.float32)
    grid.point_data["pressure_Pa"] = wall.pressure.astype(np.float32)
    return grid


def write_index(path: Path, pattern: str, times: list[float]) -> None:
    """Write the .pvd file that gives the file `pattern.format(i)` the i-th time [s]."""
    root: Any = ElementTree.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = ElementTree.SubElement(root, "Collection")
    for number, time in enumerate(times):
        ElementTree.SubElement(collection, "DataSet", timestep=repr(float(time)), part="0", file=pattern.format(number))
    ElementTree.indent(root)
    partial = path.with_name(f"part-{path.name}")
    ElementTree.ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)
    partial.replace(path)
