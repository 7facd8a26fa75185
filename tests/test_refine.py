"""`ngfsi run --refine`: what is marked, what a refined mesh keeps, and what it gains over an even one of its size."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.channel import CylinderInDuct, CylinderMesh
from ngfsi_geometry.external import ExternalMesh
from ngfsi_geometry.segment import MeshSettings
from typer.testing import CliRunner

from ngfsi.case import Case
from ngfsi.cli import app
from ngfsi.config.functions import PressureConstant
from ngfsi.errors import CaseError, GeometryError, OutputError
from ngfsi.measure.probe import Probe
from ngfsi.mesh.domain import Domain
from ngfsi.run import run
from ngfsi.run.refine import check_refinable, mark
from ngfsi.store import StoredRun, open_run
from ngfsi.store.export import of_domain, write
from ngfsi.system.system import System
from tests.output.fake import fake_run
from tests.runs import row
from tests.vein import COARSE, TUBE, case_of, domain_of

ENDS = (0.125, 0.25, 0.5, 0.75, 0.875)
LONG = TUBE.replace(length=40e-3, mesh=COARSE.replace(axial_layers=4))
CASE = case_of(LONG, **{
    "loads.skin_pressure": PressureConstant(value=1000.0), "loads.outlet_pressure": PressureConstant(value=0.0),
    "conditions.ends": "clamped", "time.scheme": "static", "time.end": 0.1, "output.fields_every": 0,
    "output.wall_every": 1000,
})  # fmt: skip


def called(*arguments: str) -> Any:
    return CliRunner().invoke(app, [*arguments, "--refine", "1", "--quiet"])


def closed(found: StoredRun) -> float:
    """Return the lumen's volume at the end (m3), of the same shape at the start on all meshes."""
    return float(found.series["lumen_volume_m3"][-1])


@pytest.fixture(scope="module")
def refined(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp("refined")
    (folder / "vein.toml").write_text(CASE.to_toml())
    result = called("run", str(folder / "vein.toml"), "-o", str(folder / "found"))
    assert result.exit_code == 0, result.output
    return folder / "found", result.output


def test_layers_at_clamped_ends_are_halved(refined: tuple[Path, str]) -> None:
    """And alone; the case says so, and nothing else of it changes."""
    folder, said = refined
    found = Case.from_toml(folder / "refined_1" / "case.toml")
    assert found.geometry.mesh.layer_boundaries == ENDS
    assert found == CASE.replace(geometry=LONG.replace(mesh=LONG.mesh.replace(layer_boundaries=ENDS, axial_layers=6)))
    assert "refined_1" in said


def test_a_refined_mesh_beats_an_even_one_of_its_size(refined: tuple[Path, str], tmp_path: Path) -> None:
    """Six layers each; the reference has sixteen, eight times thinner at the ends."""

    def volume(layers: int, thinner: float = 1.0) -> tuple[float, int]:
        geometry = LONG.replace(mesh=LONG.mesh.replace(axial_layers=layers, end_refinement=thinner))
        found = run(CASE.replace(geometry=geometry), tmp_path / f"{layers}", quiet=True)
        return closed(found), found.manifest["unknowns"]

    exact, _ = volume(16, 8.0)
    even, size = volume(6)
    chosen = open_run(refined[0] / "refined_1")
    assert chosen.manifest["unknowns"] == size
    errors = [abs(value - exact) for value in (closed(open_run(refined[0])), even, closed(chosen))]
    assert errors[2] < 0.8 * errors[1] < 0.64 * errors[0]


def test_resumed(refined: tuple[Path, str]) -> None:
    """What is complete is taken as it is, and shown again."""
    folder, said = refined
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}
    again = called("resume", str(folder))
    assert again.exit_code == 0, again.output
    assert again.output == said
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()} == before


def test_the_fewest_parts_with_a_share_of_the_error() -> None:
    """And those equal to the least of them, so that a mesh stays symmetric."""
    assert mark(np.array([1.0, 8.0, 0.5, 2.0])).tolist() == [False, True, False, False]
    assert mark(np.array([4.0, 1.0, 1.0, 3.9])).tolist() == [True, False, False, True]


@pytest.mark.parametrize("order", [1, 2])
def test_bisected_tetrahedra_keep_shape_and_names(order: int, tmp_path: Path) -> None:
    """Volumes of regions and areas of boundaries to rounding, of straight and of curved cells."""
    mesh = COARSE.replace(element="tetrahedron", curving_order=order)
    file = tmp_path / "tube.msh"
    write(of_domain(domain_of(TUBE.replace(mesh=mesh))), file, "gmsh")
    given = ExternalMesh(file=str(file), unit="m")
    before = Domain.build(given)
    chosen = np.zeros(before.mesh.ne, dtype=bool)
    chosen[:5] = True
    found = given.refined(chosen[given.parts_to_refine(before.mesh)], tmp_path / "refined.msh")
    after = Domain.build(found)
    assert 2 * before.mesh.ne > after.mesh.ne >= before.mesh.ne + 5
    assert ExternalMesh.from_dict(found.to_toml_dict()) == found
    assert (found.solids, found.boundary_names) == (given.solids, given.boundary_names)
    for name in before.regions:
        assert after.volume(name) == pytest.approx(before.volume(name), rel=1e-12)
    for name in given.boundary_names:
        assert after.area(name) == pytest.approx(before.area(name), rel=1e-12)
    middles = [np.mean([before.mesh[v].point for v in before.mesh[ng.ElementId(ng.VOL, k)].vertices], axis=0)
               for k in range(5)]  # fmt: skip
    sizes = [ng.Integrate(ng.CF(1) * ng.dx, part.mesh, element_wise=True).NumPy() for part in (before, after)]
    for k, middle in enumerate(middles):
        inside = after.mesh(*after.on_straight_mesh(middle[None])[0])
        assert sizes[1][inside.nr] < sizes[0][k] / 1.99


def test_what_cannot_be_refined_is_refused(tmp_path: Path) -> None:
    with pytest.raises(GeometryError, match="'csg' has no layers"):
        check_refinable(case_of(TUBE.replace(mesh=MeshSettings(element="csg", curving_order=2))))
    write(of_domain(domain_of(TUBE)), tmp_path / "prisms.msh", "gmsh")
    prisms = case_of(TUBE).replace(geometry=ExternalMesh(file=str(tmp_path / "prisms.msh"), unit="m"))
    with pytest.raises(GeometryError, match="cells of 6 corners: only tetrahedra can be bisected"):
        check_refinable(prisms)
    duct = CASE.model_copy(update={"geometry": CylinderInDuct(mesh=CylinderMesh(far_size=0.2, cylinder_size=0.1))})
    with pytest.raises(CaseError, match="a CylinderInDuct is refined by the sizes in its table `mesh`"):
        check_refinable(duct)


def test_the_state_at_the_end_is_that_of_the_last_row(refined: tuple[Path, str]) -> None:
    found = open_run(refined[0])
    domain = Domain.build(found.case.geometry)
    system = System(found.case, domain)
    system.restore(found.end(domain.fingerprint))
    probe = Probe(system)
    probe.refresh()
    measured = row(probe)
    for name in ("lumen_volume_m3", "sawss_Pa"):
        assert measured[name] == pytest.approx(found.series[name][-1], rel=1e-9), name


def test_a_run_without_its_end(refined: tuple[Path, str], tmp_path: Path) -> None:
    """Of an earlier version, or of another mesh."""
    with pytest.raises(OutputError, match=r"end\.npz' cannot be read: No such file"):
        fake_run(tmp_path / "run").end("mesh")
    with pytest.raises(OutputError, match="is of another mesh than that of its case: compute it again"):
        open_run(refined[0]).end("mesh")


def test_layers_of_given_heights_are_refused_with_others() -> None:
    with pytest.raises(GeometryError, match=r"layer_boundaries \[0\.5, 0\.2\] must increase"):
        COARSE.replace(layer_boundaries=(0.5, 0.2), axial_layers=3)
    with pytest.raises(GeometryError, match="2 layer_boundaries are of 3 layers of given heights: leave out"):
        COARSE.replace(layer_boundaries=(0.2, 0.5), axial_layers=4)
