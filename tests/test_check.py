"""A case looked at before it is run: what is printed of its mesh, what is written, what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ngfsi_geometry.channel import Beam
from ngfsi_geometry.external import ExternalMesh
from rich.console import Console

from ngfsi import cli
from ngfsi.case import Case, Loads, Materials, TimeStepping
from ngfsi.config.functions import PressureConstant
from ngfsi.materials import load_set
from ngfsi.mesh.domain import Domain
from ngfsi.run.check import check
from ngfsi.system.system import System
from tests.geometry.test_external import ENDS, cells_of, external_of, tube, without
from tests.vein import case_of


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """A tube along (0, 0.6, 0.8) whose ends and interface are in no group."""
    points, rows = cells_of(tube("mixed", 1))
    turn = np.array([[1, 0, 0], [0, 0.8, 0.6], [0, -0.6, 0.8]]).T
    file = tmp_path_factory.mktemp("mesh") / "tube.vtu"
    return case_of(external_of(file, points @ turn, without(rows, "interface", *ENDS)))


def test_what_is_found(case: Case, tmp_path: Path) -> None:
    found = check(case, tmp_path / "out")
    domain = Domain.build(case.geometry)
    assert {name: volume for name, (_, volume) in found.regions.items()} == {
        name: pytest.approx(domain.volume(name)) for name in ("tissue", "wall", "fluid")
    }
    assert sum(count for count, _ in found.regions.values()) == domain.mesh.ne
    assert {n: area for n, (_, area) in found.boundaries.items()} == {
        n: pytest.approx(domain.area(n)) for n in domain.geometry.boundary_names
    }
    inlet, outlet = found.openings
    along = np.array([0.0, 0.6, 0.8])
    assert (inlet.name, outlet.name) == ("inlet", "outlet")
    assert outlet.normal == pytest.approx(along, abs=1e-9)
    assert inlet.normal == pytest.approx(-along, abs=1e-9)
    assert inlet.centre == pytest.approx(np.zeros(3), abs=1e-6)
    assert outlet.centre == pytest.approx(10e-3 * along, abs=1e-6)
    assert f"{System(case, domain).unknowns.size:,}, of which" in found.facts["unknowns"]
    assert any(
        s.startswith("interface: ") and s.endswith("between fluid and wall in no group") for s in found.sentences
    )
    back = Domain.build(ExternalMesh(file=str(tmp_path / "out" / "mesh.vtu"), unit="m"))
    for name in domain.regions:
        assert back.volume(name) == pytest.approx(domain.volume(name), rel=2e-6)
    console = Console(width=160)
    with console.capture() as captured:
        console.print(found.tables())
    assert f"{1e6 * inlet.area:.5g}" in captured.get()
    assert "(0.000, 0.600, 0.800)" in captured.get()
    assert (tmp_path / "out" / "mesh.png").exists() or any("OpenGL" in s for s in found.sentences)


def test_a_plane_case(tmp_path: Path) -> None:
    loads, time = Loads(skin_pressure=PressureConstant(value=0.0)), TimeStepping(step=0.5, end=1.0)
    materials = Materials(solid=load_set("mooney_rivlin_s1"))
    plane = Case(name="plane", geometry=Beam(), materials=materials, loads=loads, time=time)
    found = check(plane, tmp_path)
    assert (found.plane, found.openings) == (True, ())
    assert found.regions["solid"][1] == pytest.approx(plane.geometry.exact_volumes()["solid"])


def test_refusals_appear_at_once(case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "case.toml"
    file.write_text(case.to_toml().replace('= "wall_outer"', '= "skin"').replace('= "fluid"', '= "wall"'))
    with pytest.raises(SystemExit) as ended:
        cli.main(["check", str(file), "-o", str(tmp_path / "out")])
    said = capsys.readouterr().err
    assert (ended.value.code, said.count("\n")) == (2, 1)
    assert not (tmp_path / "out").exists()
