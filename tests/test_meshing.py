"""The guard around the mesher and the cache: crashes, hangs, refused meshes, damaged and unwritable caches."""

from __future__ import annotations

import os
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import TubeSegment
from ngsolve import CF, VOL, GridFunction, Mesh, VectorH1, x, y

from ngfsi.errors import MeshError
from ngfsi.mesh import generate as meshing
from ngfsi.mesh.domain import Domain

COARSE = MeshSettings(axial_layers=1, far_size=12e-3, vein_size=4e-3, lumen_radii=())


class Crashing(TubeSegment):
    """Ends the process at the first attempts."""

    crashes: int = 1

    def netgen_mesh(self, attempt: int = 0) -> Any:
        if attempt < self.crashes:
            os.abort()
        return super().netgen_mesh(attempt)


class Hanging(TubeSegment):
    """Never returns at the first attempt."""

    def netgen_mesh(self, attempt: int = 0) -> Any:
        if attempt == 0:
            time.sleep(1000)
        return super().netgen_mesh(attempt)


class Folded(TubeSegment):
    """Too few edges around a vein with a thin layer: arcs cross the layer's diagonals."""

    def mesh_attempts(self) -> tuple[str, ...]:
        return super().mesh_attempts()[:1]

    def _vein_segments(self, *_: Any) -> int:
        return 8


class Failing(TubeSegment):
    """Raises in the mesher."""

    def mesh_attempts(self) -> tuple[str, ...]:
        return super().mesh_attempts()[:1]

    def netgen_mesh(self, attempt: int = 0) -> Any:
        raise RuntimeError(f"attempt {attempt}: no triangle fits")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("NGFSI_CACHE", str(tmp_path))
    return tmp_path


@pytest.mark.usefixtures("guarded_mesher")
def test_crash_is_survived_and_recorded() -> None:
    domain = Domain.build(Crashing(mesh=COARSE))
    assert domain.statistics()["way_of_meshing"] == "element sizes x 0.93"
    assert domain.statistics()["warnings"] == ["the mesher with element sizes x 1 crashed with signal 6"]


@pytest.mark.usefixtures("guarded_mesher")
def test_hang_is_survived_and_recorded() -> None:
    _, report = meshing.generate(Hanging(mesh=COARSE), timeout=5)
    assert report.warnings == ("the mesher with element sizes x 1 took longer than 5 s",)


@pytest.mark.usefixtures("guarded_mesher")
def test_no_way_left() -> None:
    with pytest.raises(MeshError, match=r"no mesh of Failing could be made in 1 attempts; .* no triangle fits"):
        meshing.generate(Failing(mesh=COARSE))


@pytest.mark.usefixtures("guarded_mesher")
def test_inverted_elements_are_refused_with_advice() -> None:
    folded = Folded(mesh=COARSE.replace(lumen_radii=(0.95,)))
    with pytest.raises(
        MeshError, match=r"\d+ of \d+ curved elements are inverted, .*in region 'wall'.*make elements along"
    ):
        meshing.generate(folded)


def test_script_classes_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Crashing, "__module__", "__main__")
    with pytest.raises(MeshError, match="move the class to a module"):
        meshing.generate(Crashing(mesh=COARSE))


def test_cache(cache: Path) -> None:
    geometry = TubeSegment(mesh=COARSE)
    first, made = meshing.generate(geometry)
    second, found = meshing.generate(geometry)
    assert (made.cached, found.cached) == (False, True)
    assert np.array_equal(first.Coordinates(), second.Coordinates())
    assert Domain.build(geometry).statistics()["relative_volume_errors"]["fluid"] == pytest.approx(0, abs=1e-3)
    [entry] = (cache / "meshes").iterdir()
    (entry / meshing.MESH_FILE).write_bytes(b"damaged")
    assert not meshing.generate(geometry)[1].cached
    assert meshing.generate(geometry)[1].cached
    assert len(list((cache / "meshes").iterdir())) == 1


def test_cache_key_depends_on_every_value() -> None:
    keys = {
        meshing.content_key(geometry)
        for geometry in (
            TubeSegment(),
            TubeSegment(length=60e-3),
            TubeSegment(mesh=COARSE),
            TubeSegment(lumen_diameter=np.nextafter(11.1e-3, 1.0).item()),
            Crashing(),
        )
    }
    assert len(keys) == 5
    assert meshing.content_key(TubeSegment(length=50e-3)) in keys  # the default, given


def test_unwritable_cache_is_no_obstacle(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (cache / "file").write_text("not a folder")
    monkeypatch.setenv("NGFSI_CACHE", str(cache / "file"))
    _, report = meshing.generate(TubeSegment(mesh=COARSE))
    assert not report.cached


def test_shape_counts_in_the_jacobian() -> None:
    mesh = Mesh(TubeSegment(mesh=COARSE).netgen_mesh())
    shape = GridFunction(VectorH1(mesh, order=3))
    assert meshing.jacobian_ratios(mesh, shape) == pytest.approx(np.ones(mesh.ne), rel=1e-9)  # straight prisms
    shape.Set(CF((0.2 * x, -0.1 * y, 0)))
    assert meshing.check_shape(mesh, shape) == pytest.approx(1.0, rel=1e-9)  # stretching leaves them affine
    shape.Set(CF((-40 * x * x, -0.1 * y, 0)))  # det = 0.9 (1 - 80 x): folds beyond x = 1 / 80 m
    ratios = meshing.jacobian_ratios(mesh, shape)
    reach = np.array([max(mesh[v].point[0] for v in e.vertices) for e in mesh.Elements(VOL)])
    assert np.all(ratios[reach < 1 / 80] > 0)
    assert np.all(ratios[reach > 1.2 / 80] < 0)
    with pytest.raises(MeshError, match="curved elements are inverted, the worst in region 'tissue'") as caught:
        meshing.check_shape(mesh, shape)
    said = re.match(r"(\d+) of (\d+) .* near \((\S+), .*\) mm", str(caught.value))
    assert said is not None
    assert [int(said[1]), int(said[2])] == [np.count_nonzero(ratios < 0), mesh.ne]
    assert 1e3 / 80 < float(said[3]) < 20  # the tissue's radius


def test_ratio_of_a_curved_element() -> None:
    """A square of deformation x -> x + x^2 / (2 c) has the determinant 1 + x / c at each x."""
    mesh = Mesh(TubeSegment(mesh=COARSE).netgen_mesh())
    shape = GridFunction(VectorH1(mesh, order=2))
    shape.Set(CF((x * x / 0.2, 0, 0)))
    extents = [[mesh[v].point[0] for v in e.vertices] for e in mesh.Elements(VOL)]
    ratios = np.array([(1 + min(xs) / 0.1) / (1 + max(xs) / 0.1) for xs in extents])
    found = meshing.jacobian_ratios(mesh, shape)
    assert np.all(found >= ratios - 1e-12)  # quadrature points lie inside
    assert found == pytest.approx(ratios, abs=0.05)
