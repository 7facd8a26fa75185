"""A case looked at before it is run: mesh, names, openings, quality, unknowns and likely costs. Nothing is solved."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import ngsolve as ng
import numpy as np
from rich.console import Group, RenderableType
from rich.table import Column, Table

from ngfsi.arrays import Array
from ngfsi.case import Case
from ngfsi.case.plausible import implausible
from ngfsi.mesh.centreline import find_centrelines
from ngfsi.mesh.domain import Domain
from ngfsi.report.mesh_picture import mesh_picture
from ngfsi.run.computation import fitting_backend
from ngfsi.store.disk import explained
from ngfsi.store.export import of_domain, write
from ngfsi.system.system import System
from ngfsi.units import from_si, in_unit

MEASURED = 23_000.0
"""Unknowns at which the costs below were measured (docs/solvers.md, order 2)."""
COSTS = {"p_multigrid": ((0.68, 1.08), (1.95, 1.19)), "": ((0.92, 1.21), (0.83, 1.44))}
"""Iterative and direct solvers: memory (GB) and seconds a step at `MEASURED`, and the powers with which they grow."""
AT_REST = 8.0
"""Steps that the state at t = 0 takes as long as."""


@dataclass(frozen=True)
class Opening:
    """An inlet or outlet: area [m2], normal out of the blood, and centre [m]."""

    name: str
    area: float
    normal: Array
    centre: Array


@dataclass(frozen=True)
class Check:
    """What is known of a case before it is run.

    Attributes:
        sentences: what is odd, and what was inferred.
        regions: name -> number of elements, volume [m3], in the plane area [m2].
        boundaries: name -> number of faces, area [m2], in the plane length [m].
        facts: what else there is to be said, by name.
        plane: whether the mesh is one of two dimensions.
    """

    sentences: tuple[str, ...]
    regions: dict[str, tuple[int, float]]
    boundaries: dict[str, tuple[int, float]]
    openings: tuple[Opening, ...]
    facts: dict[str, str]
    plane: bool

    def tables(self) -> RenderableType:
        """Return it for the terminal."""
        size = ("area", "mm2", "length", "mm") if self.plane else ("volume", "mm3", "area", "mm2")
        parts: list[RenderableType] = []
        for title, rows, what, unit in (
            ("Region", self.regions, size[0], size[1]), ("Boundary", self.boundaries, size[2], size[3]),
        ):  # fmt: skip
            table = Table(title.lower(), Column("elements", justify="right"), Column(f"{what} {unit}", justify="right"))
            for name, (count, value) in rows.items():
                table.add_row(name, f"{count:,}", f"{_in_mm(value, unit):.6g}")
            parts.append(table)
        if self.openings:
            table = Table("opening", Column(f"{size[2]} {size[3]}", justify="right"), "normal", "centre mm")
            for opening in self.openings:
                table.add_row(opening.name, f"{_in_mm(opening.area, size[3]):.5g}", _triple(opening.normal, "z.3f"),
                              _triple(from_si(opening.centre, "mm").round(9), ".4g"))  # fmt: skip
            parts.append(table)
        facts = Table.grid("", "", padding=(0, 2))
        for name, text in self.facts.items():
            facts.add_row(name, text)
        return Group(*parts, facts, *(f"! {sentence}" for sentence in self.sentences))


def _in_mm(value: float, unit: str) -> float:
    """Return an SI value in mm, mm2 or mm3."""
    return float(value * from_si(1.0, "mm") ** int(unit[2:] or 1))


def _triple(values: Array, form: str) -> str:
    return f"({', '.join(format(float(value), form) for value in values)})"


def check(case: Case, folder: Path) -> Check:
    """Build the mesh and the unknowns of a case, and write `mesh.vtu` and `mesh.png` into a folder.

    Raises:
        NgfsiError: what `run` would refuse it for.
    """
    start = perf_counter()
    domain = Domain.build(case.geometry)
    seconds = perf_counter() - start
    system = System(case, domain)
    for vessel in domain.vessels:
        if vessel.lumen and vessel.inlets and vessel.outlets and domain.mesh.dim == 3:
            find_centrelines(domain, vessel)
    openings = tuple(
        _opening(domain, vessel.lumen, name) for vessel in domain.vessels if vessel.lumen for name in vessel.openings
    )
    named = of_domain(domain)
    with explained(folder):
        folder.mkdir(parents=True, exist_ok=True)
        write(named, folder / "mesh.vtu", "vtu")
    places = {one.name: tuple(float(x) for x in np.resize([*one.centre, 0.0], 3)) for one in openings}
    failure = mesh_picture(named, places, folder / "mesh.png")
    regions = Counter(element.mat for element in domain.mesh.Elements(ng.VOL))
    faces = Counter(element.mat for element in domain.mesh.Elements(ng.BND))
    facts = _facts(case, domain, system)
    facts |= {"mesh": f"{domain.report.way}, {seconds:.1f} s", "written": f"{folder / 'mesh.vtu'}" + (
        "" if failure else f", {folder / 'mesh.png'}")}  # fmt: skip
    return Check(
        (*implausible(case), *getattr(case.geometry, "remarks", ()), *((failure,) if failure else ())),
        {name: (regions[name], domain.volume(name)) for name in domain.regions},
        {name: (faces[name], domain.area(name)) for name in case.geometry.boundary_names},
        openings, facts, domain.mesh.dim == 2,
    )  # fmt: skip


def _opening(domain: Domain, lumen: str, name: str) -> Opening:
    normal = domain.outward_normal(lumen)
    over = domain.ds(name, bonus_intorder=8)
    mean = np.array([ng.Integrate(normal[i] * over, domain.mesh) for i in range(domain.mesh.dim)])
    return Opening(name, domain.area(name), mean / np.linalg.norm(mean), domain.centroid(name))


def _facts(case: Case, domain: Domain, system: System) -> dict[str, str]:
    statistics = domain.statistics()
    straight = np.array([vertex.point for vertex in domain.mesh.vertices])
    ends = np.array([[vertex.nr for vertex in edge.vertices] for edge in domain.mesh.edges])
    lengths = np.linalg.norm(straight[ends[:, 0]] - straight[ends[:, 1]], axis=1)
    unknowns = system.unknowns
    solved = sum(int(np.count_nonzero(unknowns.free(name))) for name in unknowns.to_solve)
    backend, _ = fitting_backend(system)
    iterates = backend in ("p_multigrid", "fieldsplit")
    (memory, grows), (step, slows) = COSTS["p_multigrid" if iterates else ""]
    ratio = solved / MEASURED
    steps = case.time.steps
    minutes = step * ratio**slows * (steps + AT_REST) / 60
    kinds = ", ".join(f"{count:,} {kind}" for kind, count in statistics["elements_by_type"].items())
    shortest, longest = (in_unit(float(length), "mm", ".3g") for length in (lengths.min(), lengths.max()))
    worst, orders = statistics["smallest_jacobian_ratio"], (domain.geometry.curving_order, case.discretisation.order)
    return {
        "elements": f"{kinds}, of order {orders[0]} in shape, {orders[1]} in motion",
        "quality": f"least over largest Jacobian determinant of an element {worst:.3g} at worst (1: straight, 0: "
        f"inverted), edges of {shortest} to {longest}",
        "unknowns": f"{unknowns.size:,}, of which {solved:,} are solved for by {backend}",
        "likely costs": f"{0.3 + memory * ratio**grows:.1f} GB, {minutes:.2g} min on one core for {steps} steps; "
        "within a factor of three, from the calf's (docs/solvers.md)",
    }
