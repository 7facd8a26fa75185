"""The curved reference shape: conforming elements, on the geometry's surfaces as exactly as the order allows."""

from __future__ import annotations

from math import pi
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import TubeSegment
from ngsolve import CF, GridFunction, Integrate, Mesh, VectorH1, div, specialcf, x, y, z

from ngfsi.mesh.curving import reference_shape
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.generate import MeshReport

ELEMENTS = ("prism", "mixed", "tetrahedron")
RADIUS = 5.55e-3
ENDS = ("inlet", "outlet", "wall_bottom", "wall_top")
LUMEN = ("interface", "inlet", "outlet")


def tube(element: Any, order: int) -> TubeSegment:
    mesh = MeshSettings(element=element, curving_order=order, axial_layers=2, far_size=12e-3, lumen_radii=(0.6,))
    return TubeSegment(length=20e-3, mesh=mesh)


def domain_of(geometry: Any) -> Domain:
    return Domain(Mesh(geometry.netgen_mesh()), geometry, MeshReport("direct", (), 0.0))


def random_field(domain: Domain, order: int, *regions: str) -> GridFunction:
    field = GridFunction(VectorH1(domain.mesh, order=order, definedon=domain.materials(*regions)))
    field.vec.FV().NumPy()[:] = np.random.default_rng(0).standard_normal(len(field.vec))
    return field


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("element", ELEMENTS)
def test_divergence_theorem_closes(element: Any, order: int) -> None:
    """For any finite element field on the lumen: no gaps or overlaps, which would be sources of blood.

    Elements curved by Netgen itself miss this by up to 1e-4 where they are prisms or hexahedra.
    """
    domain = domain_of(tube(element, order))
    n = specialcf.normal(3)
    for regions, surface in ((("fluid",), LUMEN), (("fluid", "wall"), ("wall_outer", *ENDS))):
        field = random_field(domain, order, *regions)
        inside = Integrate(div(field) * domain.dx(*regions, bonus_intorder=8), domain.mesh)
        through = Integrate(field * n * domain.ds(*surface, bonus_intorder=8), domain.mesh)
        size = Integrate(ng.Norm(field) * domain.ds(*surface, bonus_intorder=8), domain.mesh)
        assert abs(inside) > 1e-3 * size
        assert abs(inside - through) < 1e-12 * size, regions


@pytest.mark.parametrize("element", ELEMENTS)
def test_surfaces_lie_on_the_circles(element: Any) -> None:
    """Errors fall with the order, on curved faces and along their rims; flat ends stay flat."""
    errors = {}
    for order in (1, 2, 3, 4):
        domain = domain_of(tube(element, order))
        off = ((x * x + y * y) ** 0.5 / RADIUS - 1) ** 2
        errors[order] = (
            Integrate(off * domain.ds("interface", bonus_intorder=8), domain.mesh) / domain.area("interface")
        ) ** 0.5
        for name, height in (("inlet", 0.0), ("wall_bottom", 0.0), ("tissue_top", 20e-3)):
            assert Integrate((z - height) ** 2 * domain.ds(name), domain.mesh) < 1e-30
    assert errors[1] == pytest.approx(0.018, rel=0.1)  # chords of 14 edges
    assert max(errors[2], errors[3]) < 2e-4
    assert errors[4] < 2e-6


def test_the_mesh_itself_stays_straight() -> None:
    domain = domain_of(tube("prism", 3))
    mesh = domain.mesh
    assert mesh.GetCurveOrder() == 1
    shape = mesh.deformation
    mesh.UnsetDeformation()
    area = Integrate(CF(1) * ng.ds(definedon=mesh.Boundaries("inlet")), mesh)
    segments = sum(1 for e in mesh.Boundaries("interface").Elements()) // 2
    assert area == pytest.approx(segments / 2 * np.sin(2 * pi / segments) * RADIUS**2, rel=1e-9)
    mesh.SetDeformation(shape)
    assert domain.area("inlet") == pytest.approx(pi * RADIUS**2, rel=1e-4)


def test_vertices_do_not_move() -> None:
    """They are on the surfaces already."""
    geometry = tube("prism", 3)
    mesh = Mesh(geometry.netgen_mesh())
    names = [*geometry.boundary_names, "lumen_layer"]
    shape = reference_shape(mesh, names, 3, None)
    moved = np.array([shape(mesh(*v.point)) for v in mesh.vertices])
    assert np.abs(moved).max() < 1e-12 * RADIUS
    assert mesh.deformation is None


def test_shape_map_follows_the_curving() -> None:
    """It is a function of places on the curved shape: a linear map of those is exact at any order."""
    geometry = tube("prism", 2)
    mesh = Mesh(geometry.netgen_mesh())
    names = [*geometry.boundary_names, "lumen_layer"]
    plain = reference_shape(mesh, names, 2, None)
    mapped = reference_shape(mesh, names, 2, CF((0.3 * y, -0.2 * x, 0.5 * z)))
    position = CF((x, y, z)) + plain
    wanted = position + CF((0.3 * position[1], -0.2 * position[0], 0.5 * position[2]))
    error = Integrate((CF((x, y, z)) + mapped - wanted) ** 2, mesh)
    assert error < 1e-24 * Integrate(wanted * wanted, mesh)
