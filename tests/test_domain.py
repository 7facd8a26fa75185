"""Domain: names are resolved or refused, measures pass their options, the mesh must keep what the geometry promised."""

from __future__ import annotations

from typing import Any

import pytest
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import TubeSegment
from ngsolve import CF, GridFunction, Integrate, Mesh, VectorH1, ngsglobals

from ngfsi.errors import MeshError, RegionError
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.generate import MeshReport

COARSE = TubeSegment(length=20e-3, mesh=MeshSettings(axial_layers=2, far_size=12e-3, vein_size=4e-3, lumen_radii=()))
REPORT = MeshReport("direct", (), 0.0)


def domain_of(geometry: TubeSegment) -> Domain:
    return Domain(Mesh(geometry.netgen_mesh()), geometry, REPORT)


@pytest.fixture(scope="module")
def domain() -> Domain:
    return domain_of(COARSE)


def test_regions_are_unions(domain: Domain) -> None:
    parts = domain.volume("tissue") + domain.volume("wall")
    assert domain.volume("tissue", "wall") == pytest.approx(parts, rel=1e-14)
    assert domain.volume() == pytest.approx(parts + domain.volume("fluid"), rel=1e-14)
    assert domain.area("inlet", "outlet") == pytest.approx(2 * domain.area("inlet"), rel=1e-12)
    assert sum(domain.materials("wall").Mask()) == 1


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("fliud", "'fliud' is not a known region: did you mean 'fluid'\\? known are fluid, tissue, wall"),
        ("skin", "'skin' is a boundary, not a region: known as region are fluid, tissue, wall"),
        ("Fluid", "did you mean 'fluid'"),
        ("fluid|wall", "not a known region"),
        (".*", "not a known region"),
        ("", "not a known region"),
        (3, "'3' is not a known region"),
    ],
)
def test_unknown_region(domain: Domain, name: Any, sentence: str) -> None:
    for use in (domain.materials, domain.dx, domain.volume):
        with pytest.raises(RegionError, match=sentence):
            use("tissue", name)


def test_unknown_boundary(domain: Domain) -> None:
    for use in (domain.boundaries, domain.ds, domain.area):
        with pytest.raises(RegionError, match="'inlett' is not a known boundary: did you mean 'inlet'"):
            use("inlett")
    with pytest.raises(RegionError, match="'fluid' is a region, not a boundary"):
        domain.ds("fluid")
    with pytest.raises(RegionError, match="not a known boundary"):
        domain.ds("tibia")


def test_measures_pass_their_options(domain: Domain) -> None:
    one = CF(1.0)
    around = Integrate(one * domain.dx("fluid", element_boundary=True), domain.mesh)
    faces = domain.area("inlet", "outlet", "interface")
    assert around > faces
    exact = domain.geometry.exact_volumes()["fluid"]
    assert Integrate(one * domain.dx("fluid", bonus_intorder=8), domain.mesh) == pytest.approx(exact, rel=1e-3)
    with pytest.raises(TypeError):
        domain.dx("fluid", no_such_option=1)


def test_statistics(domain: Domain) -> None:
    statistics = domain.statistics()
    assert sum(statistics["elements_by_region"].values()) == statistics["elements"] == domain.mesh.ne
    assert sum(statistics["elements_by_type"].values()) == domain.mesh.ne
    assert 0 < statistics["smallest_jacobian_ratio"] <= 1
    assert set(statistics["relative_volume_errors"]) == {"tissue", "wall", "fluid"}
    assert statistics["warnings"] == []


class Forgetful(TubeSegment):
    """Gives one boundary another name than promised."""

    def netgen_mesh(self, attempt: int = 0) -> Any:
        mesh = super().netgen_mesh(attempt)
        names = [face.bcname for face in mesh.FaceDescriptors()]
        mesh.SetBCName(names.index("outlet"), "outflow")
        return mesh


class Promising(TubeSegment):
    """Promises a region that is not there."""

    @property
    def solids(self) -> tuple[str, ...]:
        return "tissue", "wall", "bone"


def test_names_must_be_those_promised() -> None:
    mesh = COARSE.mesh
    with pytest.raises(MeshError, match=r"missing \['outlet'\], not promised \['outflow'\]"):
        domain_of(Forgetful(mesh=mesh))
    with pytest.raises(MeshError, match=r"other regions than promised: missing \['bone'\], not promised none"):
        domain_of(Promising(mesh=mesh))


def test_lost_curvature_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """As when a mesh file has lost its geometry: the straight elements would cut 3 % off the lumen."""
    monkeypatch.setattr("ngfsi.mesh.domain.shape_of", lambda mesh, _: GridFunction(VectorH1(mesh, order=1)))
    with pytest.raises(MeshError, match=r"region '\w+' of the mesh has -\d"):
        domain_of(COARSE)


def test_message_level_is_left_alone(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NGFSI_CACHE", str(tmp_path))
    before = ngsglobals.msg_level
    ngsglobals.msg_level = 3
    try:
        Domain.build(COARSE)
        assert ngsglobals.msg_level == 3
    finally:
        ngsglobals.msg_level = before
