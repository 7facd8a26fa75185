"""A user's own mesh of a vessel from a file of another program, with its groups as checked names."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property, lru_cache
from math import pi
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, NgfsiError, unknown
from ngfsi.mesh.cells import TETRA
from ngfsi.mesh.curving import EdgeBulges
from ngfsi.mesh.geometry import Vessel
from ngfsi.units import to_si
from ngfsi_geometry.bisection import bisected
from ngfsi_geometry.content import check_digest, digest
from ngfsi_geometry.meshfiles import read
from ngfsi_geometry.meshfiles.smooth import recovered
from ngfsi_geometry.meshfiles.sorting import (
    BOUNDARIES,
    FLAT,
    OMITTED,
    OPENING,
    REGIONS,
    Contents,
    contents,
    is_boundary,
    plane_of,
    turned,
)

Array = NDArray[np.float64]
Unit = Literal["m", "cm", "mm", "um"]


class ExternalMesh(ConfigModel):
    """A mesh from a file: a vessel along any line, with any number of flat openings, in the coordinates of the file.

    Regions are fluid, wall and tissue, those that the file has. Blood enters through the boundaries inlet, inlet_2 ...
    and leaves through outlet, outlet_2 ... A face in no group is the interface between blood and a solid, the outer
    wall between wall and tissue, and an end of wall or tissue in the plane of an inlet (bottom) or of an outlet (top).
    Without tissue the outer surface of the wall is the skin, on which the pressure from outside acts.
    """

    refusal: ClassVar[type[NgfsiError]] = GeometryError
    guarded: ClassVar[bool] = False
    """There is nothing to mesh."""

    file: str = Field(min_length=1)
    """A file, or a folder of files of one mesh, whose nodes are matched by their places."""
    unit: Unit = "mm"
    """Unit of length in the file."""
    names: dict[str, str] = Field(default_factory=dict)
    """Group in the file, by its name, its number or "dimension:number" -> name of the region or boundary; others must
    have these names. An empty name leaves cells out."""
    groups: str | None = None
    """Array of numbers of the cells' groups, where the file has several; default: those that programs are known to
    write, or the only one."""
    smooth: tuple[str, ...] = ()
    """Boundaries whose straight faces are curved after a smooth surface through their nodes."""
    sha256: str = Field(default_factory=lambda given: digest(given["file"], "mesh"))
    """Of the file: a case belongs to its content."""

    @model_validator(mode="after")
    def _can_be_used(self) -> Self:
        check_digest(self.file, "mesh", self.sha256)
        if wrong := next((n for n in self.names.values() if n not in (*REGIONS, OMITTED) and not is_boundary(n)), None):
            raise ValueError(unknown("region or boundary", wrong, (*REGIONS, *BOUNDARIES, "inlet_2", "outlet_2")))
        needed = {"inlet", "outlet", "interface"} if self.fluid else set()
        if missing := sorted(needed - set(self.boundary_names)):
            raise ValueError(
                f"'{self.file}' has no cells of {', '.join(missing)}: name its groups, which are "
                f"{self._loaded.titles}, in `names`"
            )
        for name in (*self._openings("inlet"), *self._openings("outlet")):
            self._check_flat(name)
        return self

    def _check_flat(self, name: str) -> None:
        points, curved = self._contents.points, self._contents.curved
        faces = [corners for title, _, _, corners in self._contents.faces if title == name]
        plane, nodes = plane_of(points, faces), np.concatenate([part.ravel() for part in faces])
        here = np.isin(curved.edges, nodes).all(axis=1)
        middles = points[curved.edges[here]].mean(axis=1) + curved.bulges[here]
        away = plane.distance(np.vstack([points[nodes], middles]))
        if away > FLAT * plane.radius:
            raise ValueError(
                f"the {name} of '{self.file}' must be flat: a node lies {1e3 * away:.3g} mm off its plane, more than "
                f"{FLAT:.1%} of its radius of {1e3 * plane.radius:.3g} mm: cut the vessel by a plane there, and give "
                f"each opening a name of its own ({name}, {name.partition('_')[0]}_2 ...)"
            )

    def _openings(self, kind: str) -> tuple[str, ...]:
        """Return the names of the inlets or of the outlets, by their numbers."""
        found = [match for name in self.boundary_names if (match := OPENING.fullmatch(name)) and match[1] == kind]
        return tuple(match[0] for match in sorted(found, key=lambda match: int(match[2] or 1)))

    @property
    def _loaded(self) -> Loaded:
        return _load(self.file, self.sha256, self.unit, tuple(self.names.items()), self.groups, self.smooth)

    @property
    def _contents(self) -> Contents:
        return self._loaded.contents

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was inferred, left out or not used, a sentence each."""
        return self._contents.remarks

    @property
    def _regions(self) -> set[str]:
        return {name for name, _, _ in self._contents.cells}

    @property
    def solids(self) -> tuple[str, ...]:
        """Names of the solids."""
        return tuple(name for name in ("tissue", "wall") if name in self._regions)

    @property
    def fluid(self) -> str | None:
        """Name of the blood, if there is any."""
        return "fluid" if "fluid" in self._regions else None

    @property
    def vessels(self) -> tuple[Vessel, ...]:
        """The vessel; none in solids without an interface."""
        if "interface" not in self.boundary_names:
            return ()
        wall = "wall" if "wall" in self._regions else None
        outer = "wall_outer" if "wall_outer" in self.boundary_names else None
        inlets, outlets = self._openings("inlet"), self._openings("outlet")
        return (Vessel(lumen=self.fluid, wall=wall, outer=outer, inlets=inlets, outlets=outlets, radius=self.size),)

    @property
    def curving_order(self) -> int:
        """2 if cells are curved, else 1."""
        return 2 if len(self._contents.curved.edges) else 1

    @property
    def boundary_names(self) -> tuple[str, ...]:
        """Every boundary of the mesh."""
        return tuple(dict.fromkeys(name for name, *_ in self._contents.faces))

    @property
    def internal_names(self) -> tuple[str, ...]:
        """Boundaries inside a region: none."""
        return ()

    @property
    def rigid_names(self) -> tuple[str, ...]:
        """Boundaries that are fixed in space: bones, and without solids the wall."""
        fixed = ("tibia", "fibula") if self.solids else ("interface",)
        return tuple(name for name in fixed if name in self.boundary_names)

    @property
    def length(self) -> float:
        """Distance [m] of the first inlet and the first outlet; without blood the longest extent of the mesh."""
        if not self.fluid:
            return float(np.max(np.ptp(self._contents.points, axis=0)))
        measured = self._loaded.measured
        return float(np.linalg.norm(measured["outlet"][1] - measured["inlet"][1]))

    @property
    def size(self) -> float:
        """Radius [m] of the circle with the area of the first inlet; without blood half of the mesh's least extent."""
        if not self.fluid:
            return float(np.min(np.ptp(self._contents.points, axis=0))) / 2
        return float(np.sqrt(self._loaded.measured["inlet"][0] / pi))

    @property
    def lumen_radius(self) -> float:
        """Radius of the lumen [m]."""
        return self.size

    @property
    def wall_thickness(self) -> float:
        """Thickness [m] of a round wall with the volume and the inner area of this one; 0 without a wall."""
        if "wall" not in self._regions or "interface" not in self._loaded.measured:
            return 0.0
        mean = self._loaded.volumes["wall"] / self._loaded.measured["interface"][0]
        return self.size * (float(np.sqrt(1 + 2 * mean / self.size)) - 1)

    @property
    def vein_centre(self) -> tuple[float, float]:
        """Position (x, y) of the first inlet's centre [m]."""
        x, y, _ = self._loaded.measured["inlet"][1].tolist()
        return x, y

    def inflow(self) -> None:
        """Return nothing: the developed profile in an inlet of any shape is found on the mesh."""

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of each region as the cells of the file have it."""
        return dict(self._loaded.volumes)

    def shape_map(self) -> EdgeBulges | None:
        """Return the displacement [m] from the straight cells to the curved ones; None if they are straight."""
        return self._contents.curved if self.curving_order > 1 else None

    def mesh_attempts(self) -> tuple[str, ...]:
        """Return the one way to mesh."""
        return ("the cells of the file",)

    def netgen_mesh(self, attempt: int = 0) -> Any:  # noqa: ARG002 - there is one way
        """Return the straight Netgen mesh [m] with its names."""
        return netgen_mesh(self._contents)

    def parts_to_refine(self, mesh: Any) -> NDArray[np.int64]:
        """Return the number of each element of a mesh: each may be bisected by itself.

        Raises:
            GeometryError: there are other cells than tetrahedra.
        """
        if others := sorted({kind.corners for _, kind, _ in self._contents.cells} - {TETRA.corners}):
            raise GeometryError(
                f"'{self.file}' has cells of {' and '.join(map(str, others))} corners: only tetrahedra can be bisected"
            )
        return np.arange(mesh.ne)

    def refined(self, marked: NDArray[np.bool_], file: Path) -> Self:
        """Return the mesh of the same shape with some of its tetrahedra bisected, written to a file.

        Raises:
            MeshError: it could not be made.
        """
        bisected(self._contents, lambda: netgen_mesh(self._contents), marked, file)
        return type(self)(file=str(file), unit="m")


class Loaded:
    """What a file holds, and what is measured of it; curved edges included."""

    def __init__(self, file: str, unit: Unit, names: Mapping[str, str], groups: str | None, smooth: tuple[str, ...]):
        raw = read(file, groups)
        self.titles = raw.titles
        self.contents = contents(raw, names, to_si(1.0, unit), file)
        if smooth:
            self.contents = recovered(self.contents, smooth, netgen_mesh(self.contents))

    @cached_property
    def _shaped(self) -> tuple[Any, Any]:
        """The straight mesh, and the displacement to its curved cells."""
        import ngsolve as ng

        mesh = ng.Mesh(netgen_mesh(self.contents))
        return mesh, self.contents.curved.on(ng.VectorH1(mesh, order=2))

    @cached_property
    def measured(self) -> dict[str, tuple[float, Array]]:
        """Area [m2] and centre (x, y, z) [m] of first inlet, first outlet and interface."""
        import ngsolve as ng

        mesh, shape = self._shaped
        mesh.SetDeformation(shape)
        found = {}
        for name in {"inlet", "outlet", "interface"} & {name for name, *_ in self.contents.faces}:
            over = ng.ds(definedon=mesh.Boundaries(name), bonus_intorder=4)
            area, *moments = (float(ng.Integrate(value * over, mesh)) for value in (ng.CF(1.0), ng.x, ng.y, ng.z))
            found[name] = area, np.array(moments) / area
        mesh.UnsetDeformation()
        return found

    @cached_property
    def volumes(self) -> dict[str, float]:
        """Volume [m3] of each region."""
        import ngsolve as ng

        mesh, shape = self._shaped
        det = ng.Det(ng.Id(3) + ng.Grad(shape))
        return {
            name: float(ng.Integrate(det * ng.dx(definedon=mesh.Materials(name), bonus_intorder=4), mesh))
            for name in dict.fromkeys(name for name, _, _ in self.contents.cells)
        }


@lru_cache(maxsize=8)
def _load(
    file: str, sha256: str, unit: Unit, names: tuple[tuple[str, str], ...], groups: str | None, smooth: tuple[str, ...]
) -> Loaded:  # fmt: skip
    """Return what a file of this content holds: a case asks for it many times."""
    del sha256
    return Loaded(file, unit, dict(names), groups, smooth)


def netgen_mesh(contents: Contents) -> Any:
    """Return the straight Netgen mesh [m] with its names."""
    import netgen.meshing as nm

    mesh = nm.Mesh(dim=3)
    mesh.AddPoints(np.ascontiguousarray(contents.points))
    regions = {name for name, _, _ in contents.cells}
    domains = {name: k for k, name in enumerate((n for n in REGIONS if n in regions), start=1)}
    for number, (name, behind, before, corners) in enumerate(contents.faces, start=1):
        sides = domains[behind], domains.get(before or "", 0)
        index = mesh.Add(nm.FaceDescriptor(surfnr=number, domin=sides[0], domout=sides[1], bc=number))
        mesh.SetBCName(number - 1, name)
        mesh.AddElements(dim=2, index=index, data=np.ascontiguousarray(corners, dtype=np.int32), base=0)
    for name, number in domains.items():
        mesh.SetMaterial(number, name)
    for name, kind, corners in contents.cells:
        # Netgen's base is clockwise seen from above
        data = np.ascontiguousarray(turned(kind, corners), dtype=np.int32)
        mesh.AddElements(dim=3, index=domains[name], data=data, base=0)
    return mesh
