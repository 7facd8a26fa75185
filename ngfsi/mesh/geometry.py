"""What a geometry must offer, and what a vessel is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, Self, runtime_checkable

from ngsolve import CoefficientFunction

from ngfsi.arrays import Mask, Numbers
from ngfsi.mesh.curving import ShapeMap

COMPARTMENTS = ("anterior", "lateral", "superficial_posterior", "deep_posterior")
"""Of the muscles of a calf: names of the regions that they may be."""
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Vessel:
    """One vessel: the names of its parts in the mesh, and the line through its middle.

    Attributes:
        name: begins the names of its columns; empty for the first vessel of a geometry.
        lumen: region of the blood; None: a hole, on whose boundary `interface` the blood presses.
        interface: boundary between blood and wall, which is a rigid one in a geometry without solids.
        wall: region of the wall; None: there is none.
        outer: boundary between wall and tissue; None: there is none.
        inlets, outlets: boundaries of the blood through which it enters and leaves.
        centreline: points [m] of the straight mesh, two or more, along the part of the vessel that is studied, in the
            direction from the first inlet to the first outlet; None: it is found from the mesh.
        radius: of the lumen [m], as a scale.
    """

    name: str = ""
    lumen: str | None = "fluid"
    interface: str = "interface"
    wall: str | None = "wall"
    outer: str | None = "wall_outer"
    inlets: tuple[str, ...] = ("inlet",)
    outlets: tuple[str, ...] = ("outlet",)
    centreline: tuple[Point, ...] | None = None
    radius: float = 1.0

    @property
    def openings(self) -> tuple[str, ...]:
        """All inlets and outlets."""
        return *self.inlets, *self.outlets

    @property
    def branches(self) -> tuple[str, ...]:
        """Name of each centreline: none for that from the first inlet to the first outlet; of others the opening to
        which they lead from the first inlet, or from which they lead to the first outlet."""
        return "", *self.outlets[1:], *self.inlets[1:]

    @property
    def branched(self) -> bool:
        """Whether there are several inlets or outlets."""
        return len(self.branches) > 1


class Geometry(Protocol):
    """What `Domain` needs to know of a geometry; lengths in metres."""

    @property
    def vessels(self) -> tuple[Vessel, ...]:
        """Its vessels; the first has the plain names and columns."""

    @property
    def solids(self) -> tuple[str, ...]:
        """Names of the regions of the solids."""

    @property
    def curving_order(self) -> int:
        """Polynomial order of the curved elements."""

    @property
    def boundary_names(self) -> tuple[str, ...]:
        """Every boundary the mesh must have; on an edge between two the shape map follows the earlier one."""

    @property
    def internal_names(self) -> tuple[str, ...]:
        """Boundaries inside one region that the mesh may have."""

    def mesh_attempts(self) -> Sequence[str]:
        """Return a description of each way to mesh, in the order to be tried."""

    def netgen_mesh(self, attempt: int = 0) -> Any:
        """Return the straight Netgen mesh with names and geometry; may crash or hang."""

    @property
    def rigid_names(self) -> tuple[str, ...]:
        """Boundaries that are fixed in space, and to which the fluid sticks."""

    @property
    def size(self) -> float:
        """Length [m] against which displacements are judged: of what the fluid flows through or around."""

    def inflow(self) -> CoefficientFunction | None:
        """Return the velocity of unit mean with which the fluid enters through the first inlet of the reference shape.

        None: it is not known in closed form, and the developed profile of the inlet's shape is computed.
        """

    def shape_map(self) -> ShapeMap | None:
        """Return the displacement [m] from the meshed to the reference shape, or None if they are the same."""

    def exact_volumes(self) -> dict[str, float]:
        """Return the volume [m3] of each region of the reference shape."""


@runtime_checkable
class Refinable(Protocol):
    """What a geometry offers whose mesh `ngfsi run --refine` can refine."""

    def parts_to_refine(self, mesh: Any) -> Numbers:
        """Return for each element of a mesh of the geometry the number of the part with which it is refined: its own,
        or that of a layer.

        Raises:
            GeometryError: the mesh is none that can be refined.
        """

    def refined(self, marked: Mask, file: Path) -> Self:
        """Return the geometry of the same shape whose mesh is refined in marked parts (parts,); what its keys cannot
        say is in a file that it may write."""
