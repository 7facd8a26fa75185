"""Vessels from surfaces: volumes of a cylinder, a torus and a branch, a run, refusals that say where."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
from ngfsi_geometry.from_surface import VesselFromSurface

from ngfsi.case import Case
from ngfsi.errors import GeometryError
from ngfsi.mesh.domain import Domain
from ngfsi.run import run
from tests.surfaces import BEND, LENGTH, RADIUS, branch, save, tube

RADII = {"fluid": (0.0, RADIUS), "wall": (RADIUS, RADIUS + 1), "tissue": (RADIUS + 1, RADIUS + 7)}


@pytest.mark.parametrize(("name", "capped"), [("tube.stl", True), ("tube.vtp", False)])
def test_cylinder(tmp_path: Path, name: str, capped: bool) -> None:
    """From 144 triangles, of which the prism has 4.5 % less volume; with wall and tissue, with caps or open."""
    file = tube(tmp_path / name, capped=capped)
    geometry = VesselFromSurface(file=str(file), wall_thickness=1e-3, tissue_thickness=6e-3)
    domain = Domain.build(geometry, cache=False)
    for region, (inner, outer) in RADII.items():
        exact = pi * (outer**2 - inner**2) * LENGTH * 1e-9
        assert domain.volume(region) == pytest.approx(exact, rel=2e-3), region
    assert domain.area("skin") == pytest.approx(2 * pi * (RADIUS + 7) * LENGTH * 1e-6, rel=2e-3)
    assert domain.area("inlet") == pytest.approx(pi * RADIUS**2 * 1e-6, rel=2e-3)
    assert domain.area("wall_top") == pytest.approx(pi * (2 * RADIUS + 1) * 1e-6, rel=2e-3)
    assert geometry.length == pytest.approx(LENGTH * 1e-3, rel=1e-6)


def test_torus(tmp_path: Path) -> None:
    """Pappus: the area of the section times the way of its middle."""
    file = tube(tmp_path / "bend.vtp", 12, 12, capped=False, bent=True)
    volumes = VesselFromSurface(file=str(file), wall_thickness=1e-3).exact_volumes()
    way = pi / 2 * BEND
    assert volumes["fluid"] == pytest.approx(pi * RADIUS**2 * way * 1e-9, rel=2e-3)
    assert volumes["wall"] == pytest.approx(pi * (2 * RADIUS + 1) * way * 1e-9, rel=2e-3)


def test_a_branch_runs(tmp_path: Path) -> None:
    """Volume as of the solid; what flows in flows out through both branches, more through the wider one."""
    exact = branch(tmp_path / "branch.stl")
    geometry = {"type": "vessel_from_surface", "file": str(tmp_path / "branch.stl"), "flow_layers": 1}
    pressure = {"kind": "constant", "value_mmHg": 10}
    case = Case.from_dict({
        "name": "branch", "geometry": geometry, "materials": {"fluid": {"set": "blood"}},
        "loads": {
            "inlet_flow": {"kind": "constant", "value_ml_s": 1.0}, "outlet_pressure": pressure,
            "openings": {"outlet_2": {"kind": "pressure", "pressure": pressure}},
        },
        "discretisation": {"order": 2}, "time": {"scheme": "static", "step_s": 1.0, "end_s": 1.0},
        "output": {"stations": 3},
    })  # fmt: skip
    assert case.geometry.exact_volumes()["fluid"] == pytest.approx(exact, rel=2e-3)
    series = run(case, tmp_path / "run", quiet=True).series
    flows = [series[f"flow_{name}_m3_s"][-1] for name in ("outlet", "outlet_2")]
    assert sum(flows) == pytest.approx(1e-6, rel=1e-6)
    assert flows[0] > flows[1] > 0.1e-6


def test_refused_surfaces(tmp_path: Path) -> None:
    def refused(said: str, file: Path, **more: object) -> None:
        with pytest.raises(GeometryError, match=said):
            VesselFromSurface(file=str(file), **more)

    good = tube(tmp_path / "tube.stl")
    refused("tissue_thickness needs a wall_thickness", good, tissue_thickness=1e-3)
    refused("'exit' is not a known end: known are inlet, outlet", good, names={"exit": "inlet"})
    refused("must give each end another name of inlet, outlet", good, names={"inlet": "outlet"})
    sphere = tmp_path / "sphere.stl"
    pv.Sphere().save(sphere)
    refused("it has 0 flat ends, a vessel needs two or more: cut it by planes", sphere)
    surface = pv.read(tube(tmp_path / "open.vtp", capped=False))
    points, triangles = np.asarray(surface.points), surface.faces.reshape(-1, 4)[:, 1:].tolist()
    crooked = points.copy()
    crooked[0, 2] -= 2.0
    refused(r"the end near .* mm is not flat: a node lies", save(tmp_path / "crooked.vtp", crooked, triangles))
    fin = np.vstack([points, [[20.0, 0.0, 12.0]]])
    extra = [*triangles, [triangles[40][0], triangles[40][1], len(points)]]
    refused("edges have more than two triangles, one near", save(tmp_path / "fin.vtp", fin, extra))
    twice = save(tmp_path / "two.vtp", np.vstack([points, points + 30]),
                 [*triangles, *(np.array(triangles) + len(points)).tolist()])  # fmt: skip
    refused("it is in several pieces", twice)
    fine = tube(tmp_path / "fine.vtp", 120, 90)
    refused("triangles, of which each becomes several cells: remesh it", fine)
    for content in (b"", b"solid nothing\nendsolid", bytes(range(256)) * 4):
        (tmp_path / "bad.stl").write_bytes(content)
        refused("cannot be read as a surface", tmp_path / "bad.stl")
