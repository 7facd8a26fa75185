"""Fields of a run for ParaView and pyvista: one .vtu file per time, and a .pvd file that lists the times.

Points are those of the deformed shape; the field `displacement_m` leads back to the reference shape. Volume cells are
curved, of second order whatever the order of the fields, and do not share points, so that fields may jump between
regions; the cell field `region` numbers the regions in the order of the field data `regions`. Faces of boundaries stand
in the field data `boundary_faces`, with the names `boundaries`: see `BoundaryFaces`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from ngfsi.arrays import Array
from ngfsi.errors import OutputError
from ngfsi.measure.ellipticity import principal_stretches, principal_values
from ngfsi.measure.points import Points
from ngfsi.measure.wall import WallSample
from ngfsi.mesh.cells import KINDS
from ngfsi.mesh.domain import Domain
from ngfsi.store.disk import explained, move_into_place, replace_file
from ngfsi.store.vtu import Grid

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

QUAD = 9
"""VTK's number of a plane cell with four corners."""


class CellType(NamedTuple):
    """Cells of second order of one shape.

    Attributes:
        name, number: VTK's.
        kind: in `mesh.cells`.
        corners: in NGSolve's reference element, in VTK's order.
        arms: corners to which edges lead from the first one, right-handed in cells of positive size.
        mirrored: order of the nodes that turns a cell of negative size into the same of positive size.
    """

    name: str
    number: int
    kind: str
    corners: tuple[tuple[int, ...], ...]
    arms: tuple[int, ...]
    mirrored: tuple[int, ...]

    def nodes(self) -> Array:
        """Return the nodes (n, dim) in the reference element: corners, middles of edges, and of square faces."""
        at, kind = np.array(self.corners, dtype=float), KINDS[self.kind]
        count = len(self.mirrored) - kind.corners - len(kind.edges)
        faces = [face for face in kind.faces if len(face) == 4] or [(0, 1, 2, 3)]
        groups = [*kind.edges, *(faces if count else ())]
        return np.vstack([at, *(at[list(group)].mean(axis=0) for group in groups)])


SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))
BELOW, ABOVE = (tuple((*corner, height) for corner in SQUARE) for height in (0, 1))
CELL_TYPES = {
    ng.ET.TRIG: CellType("QUADRATIC_TRIANGLE", 22, "triangle6", ((0, 0), (1, 0), (0, 1)), (1, 2), (0, 2, 1, 5, 4, 3)),
    ng.ET.QUAD: CellType("BIQUADRATIC_QUAD", 28, "quad9", SQUARE, (1, 3), (0, 3, 2, 1, 7, 6, 5, 4, 8)),
    ng.ET.TET: CellType("QUADRATIC_TETRA", 24, "tetra10", ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)), (1, 2, 3),
                        (0, 2, 1, 3, 6, 5, 4, 7, 9, 8)),
    ng.ET.PYRAMID: CellType("QUADRATIC_PYRAMID", 27, "pyramid13", (*BELOW, (0, 0, 1)), (1, 3, 4),
                            (0, 3, 2, 1, 4, 8, 7, 6, 5, 9, 12, 11, 10)),
    ng.ET.PRISM: CellType("BIQUADRATIC_QUADRATIC_WEDGE", 32, "wedge18",
                          ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)), (1, 2, 3),
                          (3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8, 12, 13, 14, 15, 16, 17)),
    ng.ET.HEX: CellType("QUADRATIC_HEXAHEDRON", 25, "hexahedron20", (*BELOW, *ABOVE), (1, 3, 4),
                        (4, 5, 6, 7, 0, 1, 2, 3, 12, 13, 14, 15, 8, 9, 10, 11, 16, 17, 18, 19)),
}  # fmt: skip


def node_rules(dim: int) -> dict[Any, ng.IntegrationRule]:
    """Return the nodes of cells as integration rules, by NGSolve's shape of element."""
    nodes = {shape: cell.nodes() for shape, cell in CELL_TYPES.items() if len(cell.corners[0]) == dim}
    return {shape: ng.IntegrationRule([tuple(p) for p in at], [1.0] * len(at)) for shape, at in nodes.items()}


class Cells:
    """The cells of a domain: curved, of second order, without common nodes, and of positive size.

    Attributes:
        at: nodes of all cells, one cell after the other, at which fields can be evaluated.
        points: (n, 2 or 3) their places [m] in the reference shape.
        order: numbers of the points of each cell, in VTK's order; ends: where those of each cell end.
        kinds: (cells,) VTK's numbers.
    """

    def __init__(self, mesh: Any) -> None:
        nodes = node_rules(mesh.dim)
        self.at = mesh.MapToAllElements(nodes, mesh.Materials(".*"))
        self.points = np.asarray(ng.CF((ng.x, ng.y, ng.z)[: mesh.dim])(self.at))
        shapes = [element.type for element in mesh.Elements(ng.VOL)]
        self.kinds = np.array([CELL_TYPES[shape].number for shape in shapes], dtype=np.uint8)
        self.ends = np.cumsum([len(nodes[shape]) for shape in shapes])
        self.order = np.arange(len(self.points))
        for shape in nodes:
            cell = CELL_TYPES[shape]
            starts = (self.ends - len(cell.mirrored))[self.kinds == cell.number]
            arms = [self.points[starts + arm] - self.points[starts] for arm in cell.arms]
            turned = starts[np.linalg.det(np.stack(arms, axis=1)) < 0]
            self.order[turned[:, None] + np.arange(len(cell.mirrored))] = turned[:, None] + np.array(cell.mirrored)

    def of(self, number: int) -> Array:
        """Return the places (nodes, 2 or 3) [m] of the nodes of a cell, in VTK's order."""
        start = self.ends[number - 1] if number else 0
        found: Array = self.points[self.order[start : self.ends[number]]]
        return found


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
    def of(cls, domain: Domain, cells: Cells) -> BoundaryFaces:
        """Return those of a domain with its cells."""
        mesh = domain.mesh
        names = list(domain.geometry.boundary_names)
        rows = []
        for face in mesh.Elements(ng.BND):
            if face.mat in names:
                sides = mesh[(face.faces if mesh.dim == 3 else face.edges)[0]].elements
                cell = min(sides, key=lambda element: element.nr)
                there = cells.of(cell.nr)[: len(mesh[cell].vertices)]
                on = [
                    int(np.argmin(np.sum((there - domain.vertices[vertex.nr][: mesh.dim]) ** 2, axis=1)))
                    for vertex in face.vertices
                ]
                rows.append([names.index(face.mat), cell.nr, *on, *[-1] * (4 - len(on))])
        return cls(names, np.array(rows, dtype=np.int32).reshape(-1, 6))


class NodeValues:
    """What is shown at the nodes of cells.

    Attributes:
        mine: which of the nodes of all cells are those of this rank's elements.
    """

    def __init__(
        self, domain: Domain, fields: Mapping[str, ng.CoefficientFunction], mine: ng.BitArray | None = None
    ) -> None:
        """Prepare.

        Args:
            fields: name with unit -> field on the whole domain. The tensors have three rows and columns in plane
                domains, too.
            mine: this rank's elements; default: all.
        """
        self._chosen = {} if mine is None else {"definedonelements": mine}
        self._points = Points(domain, domain.materials(), node_rules(domain.mesh.dim), mine)
        self.mine = self._points.mine
        # laws are costly to evaluate point by point: an elementwise projection takes a 200th of it
        space = ng.L2(domain.mesh, order=CELL_ORDER, dim=9)
        self._projected = {name: (ng.GridFunction(space), fields[name]) for name in (STRESS,) if name in fields}
        shown = {**fields, **{name: projection for name, (projection, _) in self._projected.items()}}
        self._widths = {name: field.dim for name, field in shown.items()}
        self._together = ng.CF(tuple(shown.values())) if shown else None

    def values(self) -> dict[str, Array]:
        """Return the present values (nodes, components) at this rank's nodes by name: of tensors the invariants."""
        if self._together is None:
            return {}
        for projection, field in self._projected.values():
            projection.Set(field, **self._chosen)
        ends = np.cumsum(list(self._widths.values()))[:-1]
        parts = np.split(self._points.values(self._together), ends, axis=1)
        return _invariants({name: _in_3d(part) for name, part in zip(self._widths, parts, strict=True)})


class FieldWriter:
    """Writes the fields of a run into its folder.

    Attributes:
        times: of the stored fields [s], by kind of grid.
    """

    def __init__(
        self, folder: Path, domain: Domain, volume_fields: Mapping[str, ng.CoefficientFunction],
        until: float = -np.inf, *, double: bool = False, given: Callable[[], dict[str, Array]] = dict,
    ) -> None:  # fmt: skip
        """Take the folder of the run and the reference shape.

        Args:
            volume_fields: as of `NodeValues`.
            until: fields up to this time [s] that the folder holds are kept, later ones removed.
            double: whether numbers have double precision, which takes twice the space.
            given: returns values at the nodes of all cells, which are stored before those of `volume_fields`;
                `displacement_m` must be among one or the other.

        Raises:
            OutputError: the folder cannot be read or written.
        """
        if DISPLACEMENT not in volume_fields and given is dict:
            raise ValueError(f"'{DISPLACEMENT}' must be among the fields: {sorted(volume_fields)}")
        self.folder = folder
        self._precision = np.float64 if double else np.float32
        self._given, self._values = given, NodeValues(domain, volume_fields)
        self.times = {
            name: [time for time in read_index(folder / INDEX.format(name)) if time <= until] for name in GRIDS
        }
        self._domain = domain
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

    def _store(self, name: str, time: float, make: Callable[[], Grid]) -> None:
        folder, file = self.folder / FOLDER, NUMBERED.format(name, len(self.times[name]))
        self.times[name].append(time)
        with explained(folder):
            folder.mkdir(exist_ok=True)
            partial = folder / f"part-{file}"
            make().write(partial)
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

    @cached_property
    def _cells(self) -> Cells:
        return Cells(self._domain.mesh)

    @cached_property
    def _of_cells(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """What stays the same: the regions of the cells, and names and the faces of boundaries."""
        regions = list(self._domain.regions)
        numbers = [regions.index(element.mat) for element in self._domain.mesh.Elements(ng.VOL)]
        faces = BoundaryFaces.of(self._domain, self._cells)
        fixed = {REGIONS: regions, BOUNDARIES: faces.names, FACES: faces.rows}
        return {REGION: np.array(numbers, dtype=np.int32)}, fixed

    def _volume(self) -> Grid:
        cells, values = self._cells, self._given() | self._values.values()
        points = _in_3d(cells.points) + values[DISPLACEMENT]
        data = {name: np.squeeze(part.astype(self._precision)) for name, part in values.items()}
        return Grid(points.astype(self._precision), cells.order, cells.ends, cells.kinds, data, *self._of_cells)


def _in_3d(values: Array) -> Array:
    """Return the vectors (n, 3) that vectors (n, 2) in the plane are, others as they are."""
    return np.pad(values, ((0, 0), (0, 1))) if values.shape[1] == 2 else values


def _invariants(data: dict[str, Array]) -> dict[str, Array]:
    """Return fields with what people look at in place of the tensors of the solids, if there are any."""
    found = {name: values for name, values in data.items() if name not in TENSORS}
    if STRESS in data:
        stress = data[STRESS].reshape(-1, 3, 3)
        found["hydrostatic_pressure_Pa"] = -np.trace(stress, axis1=1, axis2=2)[:, None] / 3
        found["principal_stresses_Pa"] = principal_values(stress)[:, ::-1]
    if DEFORMATION in data:
        found["principal_stretches_1"] = principal_stretches(data[DEFORMATION].reshape(-1, 3, 3))[:, ::-1]
    return found


def wall_grid(*walls: WallSample) -> Grid:
    """Return sampled walls as linear quadrilaterals with wall shear stress and pressure, several ones numbered."""

    def joined(values: Callable[[WallSample], Any]) -> Any:
        return np.concatenate([values(wall) for wall in walls]).astype(np.float32)

    firsts = np.cumsum([0, *(len(wall.points) for wall in walls[:-1])])
    nodes = np.concatenate([first + wall.quads for first, wall in zip(firsts, walls, strict=True)])
    shown = {
        "wall_shear_Pa": lambda wall: wall.shear,
        "wall_shear_axial_Pa": lambda wall: wall.tangential[:, 0],
        "wall_shear_circumferential_Pa": lambda wall: wall.tangential[:, 1],
        "wall_shear_magnitude_Pa": lambda wall: np.linalg.norm(wall.shear, axis=1),
        "pressure_Pa": lambda wall: wall.pressure,
    }
    data = {name: joined(values) for name, values in shown.items()}
    numbers = np.repeat(np.arange(len(walls)), [len(wall.quads) for wall in walls])
    vessels = {"vessel": numbers} if len(walls) > 1 else {}
    kinds = np.full(len(nodes), QUAD)
    return Grid(joined(lambda wall: wall.points), nodes.ravel(), 4 * np.arange(1, len(nodes) + 1), kinds, data, vessels)


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
