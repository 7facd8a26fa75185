"""What is measured along each centreline of a vessel: a plain vessel has one, a branched one has several.

SciPy and Matplotlib are loaded when there is something to measure, as in `sections`.
"""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import InnerProduct

from ngfsi.arrays import Array, Mask
from ngfsi.measure.sections import Sections
from ngfsi.measure.transmural import Side, WallLoad
from ngfsi.mesh.centreline import Centreline
from ngfsi.mesh.geometry import Vessel
from ngfsi.mesh.surface import across
from ngfsi.physics.kinematics import Kinematics
from ngfsi.system.system import System
from ngfsi.system.together import OnAllRanks, together

REACH, BESIDE = 1.5, 1.1
"""Factors by which an outline is made wider. Edges of elements that cross its plane within the first part the blood
before from that beyond: between vertices of a wall that bends inwards they run outside of the outline itself. Vertices
within the second are beside the section."""
AT_OPENING = 1e-2
"""Largest distance of a line's end from an opening that it begins or ends at, over the radius."""


class Branch:
    """Measurements along one centreline of a vessel.

    Attributes:
        name: of the opening to which, or from which, the centreline leads; empty for that of the first two openings.
        sections: between which the flow and the causes of SAWSS are taken; `outlines`: those that are written.
        load: pressures on the wall from inside and outside; None where there is no tissue around it.
    """

    def __init__(self, system: System, vessel: Vessel, name: str, line: Centreline, tissue: tuple[Side, str] | None,
                 layers: Layers | None, integral: Any) -> None:  # fmt: skip
        """Prepare.

        Args:
            tissue: its side of the wall's outer face and its name; None: there is none.
            layers: of elements, of a branched vessel.
            integral: returns the "flux NAME" out of an opening.
        """
        self.vessel, self.name = vessel, name
        self.sections = Sections(system, vessel, line)
        self.outlines = Sections(system, vessel, line, line.stations(system.case.output.stations))
        self.load = WallLoad(system, self.sections, *tissue) if tissue else None
        self._layers, self._integral = layers, integral
        if layers:
            first, last = vessel.inlets[0], vessel.outlets[0]
            self._openings = (name, last) if name in vessel.inlets else (first, name or last)
            self._beyond, more = (layers.beyond(one, self._openings) for one in (self.sections, self.outlines))
            self.sections.missing, self.outlines.missing = (np.isnan(rises[0]) for rises in (self._beyond, more))
            places = [system.domain.centroid(opening) for opening in self._openings]
            away = np.linalg.norm(line.points(np.array([0.0, line.length])) - places, axis=1)
            self._reaches = away < AT_OPENING * vessel.radius

    @property
    def line(self) -> Centreline:
        """The centreline."""
        return self.sections.line

    def refresh(self, shear: ng.CoefficientFunction) -> None:
        """Take the system's present state, and the wall shear stress (Pa)."""
        self.sections.refresh(shear)
        if self.load:
            self.load.refresh()

    @property
    def flows(self) -> Array:
        """Flow (m3/s) through each station in the direction of the centreline; NaN where there is no section.

        In a vessel with one inlet and one outlet it follows from the flow through the place where the inlet is now,
        which may move, and the rates of area before the station; in a branched one it is measured in a layer of
        elements around each station (see `Layers`).
        """
        if self._layers is None:
            return self.sections.local_flows(-sum(self._integral(f"through {name}") for name in self.vessel.inlets))
        flows = self._layers.values @ self._beyond
        for end, sign in ((0, -1.0), (-1, 1.0)):
            if self._reaches[end]:
                flows[end] = sign * self._integral(f"flux {self._openings[end]}")
        return np.asarray(flows)


class Layers(OnAllRanks):
    """Flow through layers of elements of the blood, by functions that rise from 0 before a layer to 1 beyond it.

    With such a function f the integral of u . grad f over the deformed blood is the flow through the levels of f, in
    the mean of them. f is continuous and linear on each element, so that the discrete balance of mass, which is tested
    with it, holds for that flow: with a rigid wall it is that of all openings beyond, to rounding.

    Attributes:
        values: (vertices,) integrals (m3/s) with the function that is 1 at one vertex, of the present state.
    """

    def __init__(self, system: System, vessel: Vessel) -> None:
        super().__init__(system)
        self._domain = system.domain
        lumen, fields = str(vessel.lumen), system.fields()
        space = ng.H1(self._domain.mesh, order=1, definedon=lumen)
        order = max(system.unknowns.order, self._domain.geometry.curving_order)
        cofactor = Kinematics(fields.grad_motion).cof
        flow = InnerProduct(fields.velocity, cofactor * ng.grad(space.TestFunction()))
        self._form = ng.LinearForm(space)
        self._form += flow.Compile() * self._domain.dx(
            lumen, bonus_intorder=2 * order, definedonelements=system.mine(ng.VOL)
        )
        self.values = np.zeros(self._domain.mesh.nv)
        self._at_openings = self._domain.vertices_on(*vessel.openings)
        edges = {edge.nr for element in self._domain.materials(lumen).Elements() for edge in element.edges}
        mesh = self._domain.mesh
        self._edges = np.array([[v.nr for v in mesh[ng.NodeId(ng.EDGE, nr)].vertices] for nr in sorted(edges)])

    def refresh(self) -> None:
        """Take the system's present state."""
        self.values = self._integrals()

    @together
    def _integrals(self) -> Array:
        self._form.Assemble()
        found = np.array(self._form.vec.FV().NumPy()[: len(self.values)])
        self.system.ranks.add(found)
        return found

    def beyond(self, sections: Sections, openings: tuple[str, str]) -> Array:
        """Return the functions' values at the vertices, (vertices, stations); NaN where a station has no section.

        Args:
            openings: before the first station, and beyond the last.
        """
        found = np.full((self._domain.mesh.nv, len(sections.stations)), np.nan)
        before, after = (self._domain.vertices_on(name)[0] for name in openings)
        outlines, points = sections.in_reference()
        for station, at in enumerate(sections.stations):
            if outlines.whole[station]:
                outline = points[outlines.station == station].reshape(-1, 3)
                disc = Disc(sections.centres[station], sections.normals[station], outline)
                found[:, station] = self._rise(disc, before, after, min(at, sections.line.length - at))
        return found

    def _rise(self, disc: Disc, before: int, after: int, room: float) -> Array | float:
        """Return the function of one section; NaN: the section does not part two vertices.

        Args:
            room: largest distance (m) from the section to which it may rise.
        """
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        vertices, edges = self._domain.vertices, self._edges
        height = disc.height(vertices)
        low, high = height[edges].T
        over = (low < 0) != (high < 0)
        part = (low[over] / (low[over] - high[over]))[:, None]
        cut = over.copy()
        cut[over] = disc.holds((1 - part) * vertices[edges[over, 0]] + part * vertices[edges[over, 1]], REACH)
        kept = edges[~cut]
        links = coo_array((np.ones(len(kept)), kept.T), shape=(len(vertices),) * 2)
        _, piece = connected_components(links, directed=False)
        if piece[before] == piece[after]:
            return np.nan
        rise = np.where(piece == piece[after], 1.0, 0.0)
        # a gentle slope, as far on both sides: then levels lie around the section evenly, also in uneven meshes
        width = min(float(np.abs(high - low)[cut].max()), room)
        near = (np.abs(height) < width) & ((height < 0) == (rise == 0)) & disc.holds(vertices, BESIDE)
        near[self._at_openings] = False
        rise[near] = (height[near] / width + 1) / 2
        return np.asarray(rise)


class Disc:
    """The part of a plane inside of an outline."""

    def __init__(self, centre: Array, normal: Array, outline: Array) -> None:
        """Prepare.

        Args:
            centre, normal: (3,) a point of the plane [m] and its unit normal.
            outline: points (n, 3) [m] in order.
        """
        from matplotlib.path import Path

        self._centre, self._normal = centre, normal
        self._axes = np.concatenate(across(normal[None]))
        flat = self._flat(outline)
        self._middle, self._path = flat.mean(axis=0), Path(flat)

    def _flat(self, points: Array) -> Array:
        return np.asarray((points - self._centre) @ self._axes.T)

    def height(self, points: Array) -> Array:
        """Return the distances (n,) [m] of points (n, 3) from the plane, positive along the normal."""
        return np.asarray((points - self._centre) @ self._normal)

    def holds(self, points: Array, wider: float) -> Mask:
        """Return which of points (n, 3) lie inside of the outline, made wider by a factor, seen along the normal."""
        arms = self._flat(points) - self._middle
        return np.asarray(self._path.contains_points(self._middle + arms / wider))
