"""Where the unknowns live and where they are fixed."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
import pytest

from ngfsi.conditions import Ends, GivenVelocity
from ngfsi.errors import CaseError
from ngfsi.mesh.domain import Domain
from ngfsi.system.unknowns import BLOCKS, Unknowns
from tests.vein import BONED, TUBE, domain_of

ENDS = ("tissue_top", "tissue_bottom", "wall_top", "wall_bottom", "inlet", "outlet")


@pytest.fixture(scope="module")
def domain() -> Domain:
    return domain_of(BONED)


def unknowns_of(domain: Domain, order: int, ends: Any) -> Unknowns:
    """Return the unknowns of a domain with a given flow at its inlet."""
    return Unknowns.build(domain, order, [Ends(domain, ends), GivenVelocity("inlet", lambda _: ng.CF((0, 0, 1)))])


def free_field(unknowns: Unknowns) -> Any:
    """Any state that the solver can reach: every free unknown at random, the others zero."""
    field = ng.GridFunction(unknowns.space)
    values = np.random.default_rng(0).standard_normal(unknowns.size)
    field.vec.FV().NumPy()[:] = np.where(unknowns.free(), values, 0.0)
    return field


def sizes(domain: Domain, field: Any, *faces: str) -> list[bool]:
    """Whether each component of a vector field is anything but zero on faces."""
    area = domain.area(*faces)
    squares = [ng.Integrate(field[i] ** 2 * domain.ds(*faces), domain.mesh) / area for i in range(3)]
    return [square > 1e-24 for square in squares]


@pytest.mark.parametrize(
    ("ends", "moves"),
    [
        ("roller", [True, True, False]),
        ("clamped", [False, False, False]),
        ("guided", [False, False, True]),
        ("free", [True, True, True]),
    ],
)
def test_ends(domain: Domain, ends: Any, moves: list[bool]) -> None:
    """Rollers let the ends of tissue, wall and lumen slide in their plane, clamps not, free ends do as they like."""
    field = free_field(unknowns_of(domain, 2, ends))
    motion = field.components[0]
    for face in ENDS:
        assert sizes(domain, motion, face) == moves, face
    assert sizes(domain, motion, "skin") == [True] * 3
    assert sizes(domain, motion, "tibia") == [False] * 3


@pytest.mark.parametrize("order", [2, 3])
def test_interface_and_inlet(domain: Domain, order: int) -> None:
    """Blood sticks to the wall, the rest of the mesh motion too; velocity is prescribed on the inlet alone."""
    unknowns = unknowns_of(domain, order, "roller")
    field = free_field(unknowns)
    motion, w, p = field.components
    assert sizes(domain, motion, "interface") == [True] * 3
    assert sizes(domain, w, "interface") == [False] * 3
    assert sizes(domain, w, "inlet") == [False] * 3
    assert sizes(domain, w, "outlet") == [True] * 3
    field.vec.FV().NumPy()[:] = 0.0
    field.vec.FV().NumPy()[unknowns.on_opening["inlet"]] = 1.0
    assert sizes(domain, w, "inlet") == [True] * 3
    assert not np.any(unknowns.free()[unknowns.on_opening["inlet"]])
    assert ng.Integrate(p * p * domain.dx("fluid"), domain.mesh) == 0.0


def test_tissue_moves_the_blood_next_to_it_only() -> None:
    """Displacements of the solids reach the lumen through the elements at the wall."""
    tube = domain_of(BONED.replace(**{"mesh.lumen_radii": (0.7, 0.4)}))
    unknowns = unknowns_of(tube, 2, "roller")
    field = free_field(unknowns)
    motion, values = field.components[0], field.vec.FV().NumPy()
    inner = np.array(values[unknowns.blocks["e"]])
    values[unknowns.blocks["e"]] = 0.0
    near, far = (np.linalg.norm(motion(tube.mesh(share * BONED.lumen_radius, 0.0, 5e-3))) for share in (0.9, 0.3))
    assert near > 0
    assert far == 0
    values[:] = 0.0
    values[unknowns.blocks["e"]] = inner
    size = {name: ng.Integrate(motion**2 * tube.dx(name), tube.mesh) for name in ("wall", "tissue", "fluid")}
    assert size["fluid"] > 0
    assert size["wall"] == size["tissue"] == 0.0
    assert not any(sizes(tube, motion, "interface"))


@pytest.mark.parametrize("order", [2, 3])
def test_equations(domain: Domain, order: int) -> None:
    """Velocity and mesh motion inside of the lumen exchange their equations, function by function."""
    unknowns = unknowns_of(domain, order, "roller")
    assert np.array_equal(unknowns.equations[unknowns.equations], np.arange(unknowns.size))
    fields = [ng.GridFunction(unknowns.space) for _ in range(2)]
    chosen = np.random.default_rng(5).choice(unknowns.blocks["w"], 7, replace=False)
    fields[0].vec.FV().NumPy()[chosen] = np.arange(1.0, 8.0)
    fields[1].vec.FV().NumPy()[unknowns.equations[chosen]] = np.arange(1.0, 8.0)
    w, m = fields[0].components[1], fields[1].components[0]
    measure = domain.dx("fluid")
    assert ng.Integrate(w**2 * measure, domain.mesh) > 0
    assert ng.Integrate((w - m) ** 2 * measure, domain.mesh) < 1e-28 * ng.Integrate(w**2 * measure, domain.mesh)


@pytest.mark.parametrize("order", [2, 3])
def test_blocks(domain: Domain, order: int) -> None:
    unknowns = unknowns_of(domain, order, "roller")
    assert np.array_equal(np.sort(np.concatenate([unknowns.blocks[name] for name in BLOCKS])), np.arange(unknowns.size))
    together = sum(unknowns.free(name).astype(int) for name in BLOCKS)
    assert np.array_equal(together, unknowns.free().astype(int))
    vertices = len({v.nr for element in domain.materials("fluid").Elements() for v in element.vertices})
    if order == 2:  # linear pressure: one unknown for each vertex
        assert unknowns.free("p").sum() == vertices


def test_without_bones() -> None:
    """Rollers leave three rigid motions, which three components hold; free ends would leave six."""
    domain = domain_of(TUBE)
    rollers, ends = (unknowns_of(domain, 2, "roller"), ("tissue_top", "tissue_bottom", "wall_top", "wall_bottom"))
    moving = [ng.CF((1, 0, 0)), ng.CF((0, 1, 0)), ng.CF((-ng.y, ng.x, 0))]
    motions, held = [], ~rollers.free("d")[rollers.blocks["d"]]
    for motion in moving:
        field = ng.GridFunction(rollers.space)
        field.components[0].Set(motion)
        assert not sizes(domain, field.components[0], *ends)[2]
        motions.append(np.array(field.vec.FV().NumPy())[rollers.blocks["d"]][held])
    assert np.linalg.matrix_rank(np.array(motions), tol=1e-6) == 3
    with pytest.raises(CaseError, match="leaves solids without bones adrift: use 'roller' or 'clamped'"):
        unknowns_of(domain, 2, "free")
