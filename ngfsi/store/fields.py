"""Fields of a run for ParaView and pyvista: one .vtu file per time, and a .pvd file that lists the times.

Points are those of the deformed shape; the field `displacement_m` leads back to the reference shape. Volume cells are
curved, of second order whatever the order of the fields, and do not share points, so that fields may jump between
regions; the cell field `region` numbers the regions in the order of the field data `regions`. Faces of boundaries stand
in the field data `boundary_faces`, with the names `boundaries`: see `BoundaryFaces`.

pyvista takes a quarter of a second to import, for which what writes no fields need not wait.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from ngfsi.errors import OutputError
from ngfsi.measure.wall import WallSample
from ngfsi.mesh.domain import Domain
from ngfsi.store.disk import explained, move_into_place, replace_file

if TYPE_CHECKING:
    import pyvista as pv

FOLDER = "fields"
GRIDS, INDEX, NUMBERED = ("volume", "wall"), "{}.pvd", "{}_{:04d}.vtu"
DISPLACEMENT = "displacement_m"
REGION = "region"
REGIONS, BOUNDARIES, FACES = "regions", "boundaries", "boundary_faces"
COLLAPSE = "collapse_mode_1"
"""Motion in which the vein would collapse, without a size of its own (see measure/stability.py)."""
STRESS, DEFORMATION = "stress_Pa", "deformation_gradient_1"
TENSORS = (STRESS, DEFORMATION)
"""Tensors of the solids, of which the invariants are written: hydrostatic pressure -tr(sigma)/3, and principal stresses
and stretches, the largest first."""
CELL_ORDER = 2
"""Higher ones make files large without being seen, and hardly any program but ParaView reads them."""

MIRRORED = {
    "QUADRATIC_TRIANGLE": [0, 2, 1, 5, 4, 3],
    "BIQUADRATIC_QUAD": [0, 3, 2, 1, 7, 6, 5, 4, 8],
    "QUADRATIC_TETRA": [0, 2, 1, 3, 6, 5, 4, 7, 9, 8],
    "QUADRATIC_HEXAHEDRON": [4, 5, 6, 7, 0, 1, 2, 3, 12, 13, 14, 15, 8, 9, 10, 11, 16, 17, 18, 19],
    "BIQUADRATIC_QUADRATIC_WEDGE": [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8, 12, 13, 14, 15, 16, 17],
}
"""VTK's name of a cell -> order of the nodes that turns one of negative size into the same of positive size."""


class BoundaryFaces:
    """Faces of the boundaries, by the cells that they are of.

    Attributes:
        names: of the boundaries.
        rows: (n, 6) number of the name, number of a cell, and the places of the face's corners among the cell's nodes,
            in order; -1 where there are fewer than four.
    """

    def __init__(self, names: Sequence[str], rows: NDArray[np.int32]) -> None:
        self.names, self.rows = list(names), rows

    @classmethod
    def of(cls, domain: Domain, nodes: Any) -> BoundaryFaces:
        """Return those of a domain.

        Args:
            nodes: of each cell, first those at its corners, their places [m] in the reference shape.
        """
        mesh = domain.mesh
        names = list(domain.geometry.boundary_names)
        owner: dict[int, int] = {}
        corners = []
        for element in mesh.Elements(ng.VOL):
            corners.append([vertex.nr for vertex in element.vertices])
            for side in element.faces if mesh.dim == 3 else element.edges:
                owner.setdefault(side.nr, element.nr)
        rows = []
        for face in mesh.Elements(ng.BND):
            if face.mat in names:
                cell = owner[(face.faces if mesh.dim == 3 else face.edges)[0].nr]
                there = np.asarray(nodes(cell))[: len(corners[cell]), : mesh.dim]
                on = [
                    int(np.argmin(np.sum((there - domain.vertices[vertex.nr]) ** 2, axis=1)))
                    for vertex in face.vertices
                ]
                rows.append([names.index(face.mat), cell, *on, *[-1] * (4 - len(on))])
        return cls(names, np.array(rows, dtype=np.int32).reshape(-1, 6))


class FieldWriter:
    """Writes the fields of a run into its folder.

    Attributes:
        times: of the stored fields [s], by kind of grid.
    """

    def __init__(
        self, folder: Path, domain: Domain, volume_fields: dict[str, ng.CoefficientFunction], until: float = -np.inf,
        *, double: bool = False,
    ) -> None:  # fmt: skip
        """Take the folder of the run and the reference shape.

        Args:
            volume_fields: name with unit -> field on the whole domain; `displacement_m` must be among them. The tensors
                have three rows and columns in plane domains, too.
            until: fields up to this time [s] that the folder holds are kept, later ones removed.
            double: whether numbers have double precision, which takes twice the space.

        Raises:
            OutputError: the folder cannot be read or written.
        """
        if DISPLACEMENT not in volume_fields:
            raise ValueError(f"'{DISPLACEMENT}' must be among the fields: {sorted(volume_fields)}")
        self.folder = folder
        self._precision = "double" if double else "single"
        self._mesh, self._names = domain.mesh, list(volume_fields)
        # laws are costly to evaluate point by point, as VTK output does: elementwise projections take a 200th of it
        space = ng.L2(domain.mesh, order=CELL_ORDER, dim=9)
        self._projected = {
            name: (ng.GridFunction(space), volume_fields[name]) for name in TENSORS if name in volume_fields
        }
        shown = volume_fields | {name: projection for name, (projection, _) in self._projected.items()}
        self._coefficients = [shown[name] for name in self._names]
        self._regions = list(domain.regions)
        numbers = [self._regions.index(element.mat) for element in domain.mesh.Elements(ng.VOL)]
        self._cell_regions = np.array(numbers, dtype=np.int32)
        self.times = {
            name: [time for time in read_index(folder / INDEX.format(name)) if time <= until] for name in GRIDS
        }
        self._domain = domain
        self._faces: BoundaryFaces | None = None
        self._forget_later_ones()

    def write(self, time: float) -> None:
        """Store the present fields as those of `time` [s].

        Raises:
            OutputError: the files cannot be written.
        """
        self._store("volume", time, self._volume)

    def write_wall(self, time: float, *walls: WallSample) -> None:
        """Store the sampled walls of the vessels, in the order of the manifest, as those of `time` [s].

        Raises:
            OutputError: the files cannot be written.
        """
        self._store("wall", time, lambda: wall_grid(*walls))

    def _store(self, name: str, time: float, make: Callable[[], pv.UnstructuredGrid]) -> None:
        folder, file = self.folder / FOLDER, NUMBERED.format(name, len(self.times[name]))
        self.times[name].append(time)
        with explained(folder):
            folder.mkdir(exist_ok=True)
            partial = folder / f"part-{file}"
            make().save(partial)
            move_into_place(partial, folder / file)
            self._list(name)

    def _list(self, name: str) -> list[str]:
        """List the stored fields, and return their files."""
        files = [NUMBERED.format(name, number) for number in range(len(self.times[name]))]
        index = self.folder / INDEX.format(name)
        if files or index.exists():
            write_index(index, [f"{FOLDER}/{file}" for file in files], self.times[name])
        return files

    def _forget_later_ones(self) -> None:
        with explained(self.folder / FOLDER):
            kept = {file for name in GRIDS for file in self._list(name)}
            for path in (self.folder / FOLDER).glob("*.vtu"):
                if path.name not in kept:
                    path.unlink()

    def _volume(self) -> pv.UnstructuredGrid:
        import pyvista as pv

        for projection, field in self._projected.values():
            projection.Set(field)
        raw = self.folder / FOLDER / "unfinished"
        ng.VTKOutput(self._mesh, coefs=self._coefficients, names=self._names, filename=str(raw), order=CELL_ORDER,
                     floatsize=self._precision).Do()  # fmt: skip
        written = raw.with_suffix(".vtu")
        grid = pv.read(written)
        written.unlink()
        for name in grid.point_data:  # vectors of plane domains
            if (values := np.asarray(grid.point_data[name])).shape[1:] == (2,):
                grid.point_data[name] = np.pad(values, ((0, 0), (0, 1)))
        _orient(grid)
        if self._faces is None:
            starts, nodes = grid.cell_offsets, grid.cell_connectivity
            points = np.asarray(grid.points)
            self._faces = BoundaryFaces.of(self._domain, lambda k: points[nodes[starts[k] : starts[k + 1]]])
        grid.points += grid.point_data[DISPLACEMENT]
        _take_invariants(grid)
        grid.cell_data[REGION] = self._cell_regions
        grid.field_data[REGIONS] = self._regions
        grid.field_data[BOUNDARIES] = self._faces.names
        grid.field_data[FACES] = self._faces.rows
        return grid


def _orient(grid: pv.UnstructuredGrid) -> None:
    """Renumber the nodes of cells that NGSolve wrote with negative size: its triangles and tetrahedra turn the other
    way."""
    import pyvista as pv

    nodes, starts = grid.cell_connectivity, grid.cell_offsets[:-1]
    a, b, c = (grid.points[nodes[starts + corner]] for corner in range(3))
    # cells of a plane domain have an area alone, and turn clockwise where it is negative
    turn = np.cross(b - a, c - a)[:, 2]
    volume = grid.compute_cell_sizes()["Volume"]
    negative = np.where(volume == 0, turn, volume) < 0
    for kind, order in MIRRORED.items():
        first = starts[negative & (grid.celltypes == pv.CellType[kind])]
        nodes[first[:, None] + np.arange(len(order))] = nodes[first[:, None] + order]


def _take_invariants(grid: pv.UnstructuredGrid) -> None:
    """Replace the tensors of the solids, if there are any, by what people look at."""
    if STRESS in grid.point_data:
        stress = np.asarray(grid.point_data.pop(STRESS)).reshape(-1, 3, 3)
        grid.point_data["hydrostatic_pressure_Pa"] = -np.trace(stress, axis1=1, axis2=2) / 3
        grid.point_data["principal_stresses_Pa"] = np.linalg.eigvalsh(stress)[:, ::-1]
    if DEFORMATION in grid.point_data:
        given = np.asarray(grid.point_data.pop(DEFORMATION))
        F = given.reshape(-1, 3, 3).astype(float)
        # a third of the time that the singular values of F take
        squared = np.linalg.eigvalsh(np.swapaxes(F, 1, 2) @ F)[:, ::-1]
        grid.point_data["principal_stretches_1"] = np.sqrt(np.maximum(squared, 0.0)).astype(given.dtype)


def wall_grid(*walls: WallSample) -> pv.UnstructuredGrid:
    """Return sampled walls as linear quadrilaterals with wall shear stress and pressure, several ones numbered."""
    import pyvista as pv

    def joined(values: Callable[[WallSample], Any]) -> Any:
        return np.concatenate([values(wall) for wall in walls]).astype(np.float32)

    firsts = np.cumsum([0, *(len(wall.points) for wall in walls[:-1])])
    nodes = np.concatenate([first + wall.quads for first, wall in zip(firsts, walls, strict=True)])
    quads = np.column_stack([np.full(len(nodes), 4), nodes])
    points = joined(lambda wall: wall.points)
    grid = pv.UnstructuredGrid(quads.ravel(), np.full(len(nodes), pv.CellType.QUAD), points)
    shown = {
        "wall_shear_Pa": lambda wall: wall.shear,
        "wall_shear_axial_Pa": lambda wall: wall.tangential[:, 0],
        "wall_shear_circumferential_Pa": lambda wall: wall.tangential[:, 1],
        "wall_shear_magnitude_Pa": lambda wall: np.linalg.norm(wall.shear, axis=1),
        "pressure_Pa": lambda wall: wall.pressure,
    }
    for name, values in shown.items():
        grid.point_data[name] = joined(values)
    if len(walls) > 1:
        grid.cell_data["vessel"] = np.repeat(np.arange(len(walls)), [len(wall.quads) for wall in walls])
    return grid


def write_index(path: Path, files: Sequence[str], times: Sequence[float]) -> None:
    """Write the .pvd file that gives each file its time [s]."""
    root: Any = ElementTree.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = ElementTree.SubElement(root, "Collection")
    for file, time in zip(files, times, strict=True):
        ElementTree.SubElement(collection, "DataSet", timestep=repr(float(time)), part="0", file=file)
    ElementTree.indent(root)
    replace_file(path, ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))


def read_index(path: Path) -> list[float]:
    """Return the times [s] in a .pvd file; none if there is no file.

    Raises:
        OutputError: the file cannot be read.
    """
    if not path.exists():
        return []
    try:
        with explained(path, "read"):
            return [float(entry.attrib["timestep"]) for entry in ElementTree.parse(path).iter("DataSet")]
    except (ElementTree.ParseError, KeyError, ValueError):
        raise OutputError(f"'{path}' is not a list of fields") from None
