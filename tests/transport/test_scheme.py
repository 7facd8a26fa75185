"""The scheme by which scalars are carried, on moved cells of all shapes, with given velocities."""

from __future__ import annotations

from functools import cache
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from netgen import occ
from numpy.typing import NDArray

from ngfsi.transport.cells import Cells, Flow
from ngfsi.transport.scheme import Scheme, Transported
from tests.lumens import Lumen, Point
from tests.vein import COARSE, TUBE, domain_of

Array = NDArray[np.float64]

L, R = TUBE.length, TUBE.lumen_radius


class Pipe(Lumen):
    """A straight pipe of tetrahedra."""

    radius: float = R
    largest: float = 0.8 * R

    @property
    def ends(self) -> dict[str, Point]:
        return {"inlet": (0.0, 0.0, 0.0), "outlet": (0.0, 0.0, L)}

    def solid(self) -> Any:
        return occ.Cylinder(occ.Axes((0, 0, 0), occ.Z), R, L)


PRISMS = TUBE.replace(mesh=COARSE.replace(axial_layers=3))
MIXED = TUBE.replace(mesh=COARSE.replace(axial_layers=2, element="mixed", lumen_radii=(0.6,)))
MESHES = {"prisms": PRISMS, "mixed": MIXED, "tetrahedra": Pipe()}


@cache
def cells_of(name: str, order: int = 2) -> Cells:
    return Cells(domain_of(MESHES[name]), order)


def flow_of(cells: Cells, motion: Any, velocity: Any) -> Flow:
    return Flow.of(cells, cells.sample(ng.CF(motion)), cells.sample(ng.CF(velocity)))


def coefficients(cells: Cells, field: Any) -> list[Array]:
    return [values[..., 0] for values in cells.sample(ng.CF(field))]


def still(cells: Cells) -> list[Array]:
    """No source."""
    return [np.zeros(at.shape[:2]) for at in cells.places]


def at_points(cells: Cells, values: list[Array]) -> Array:
    return np.concatenate([(c @ b.element.values.T).ravel() for b, c in zip(cells.blocks, values, strict=True)])


def places(cells: Cells) -> Array:
    return np.concatenate([at.reshape(-1, 3) for at in cells.places])


def bend(size: float) -> Any:
    """A displacement that is no polynomial of the cells, m."""
    s = ng.z / L
    return (size * ng.sin(3 * s) * (R + ng.y), size * ng.x * ng.exp(s), size * R * ng.cos(200 * ng.x))


def swirl(speed: float) -> Any:
    """A velocity whose divergence does not vanish, m/s."""
    return (speed * ng.y / R, -speed * ng.sin(ng.x / R), 2 * speed * (1 - (ng.x**2 + ng.y**2) / R**2))


@pytest.mark.parametrize("name", MESHES)
def test_cells_fill_the_deformed_lumen(name: str) -> None:
    """And their faces match: what leaves one enters its neighbour."""
    cells, domain = cells_of(name), domain_of(MESHES[name])
    motion = ng.GridFunction(ng.VectorH1(domain.mesh, order=2))
    motion.Set(ng.CF(bend(0.1)))
    flow = flow_of(cells, motion, swirl(0.02))
    exact = ng.Integrate(ng.Det(ng.Id(3) + ng.Grad(motion)) * domain.dx("fluid", bonus_intorder=6), domain.mesh)
    assert sum(v.sum() for v in flow.volumes) == pytest.approx(exact, rel=1e-12)
    assert np.count_nonzero(cells.inner) > np.count_nonzero(~cells.inner)
    assert {len(there) > 0 for there in cells.openings.values()} == {True}
    left = flow.through[cells.inner] + flow.through[cells.partner[cells.inner]]
    assert np.abs(left).max() <= 1e-15 * np.abs(flow.through).max()
    one_sided = [flow.through[there].sum() for there in cells.openings.values()]
    assert one_sided[0] < 0 < one_sided[1]


@pytest.mark.parametrize("name", MESHES)
def test_constants_stay_and_amounts_are_kept(name: str) -> None:
    """On a mesh that moves by a third of its volume, with a velocity that is not divergence-free."""
    cells = cells_of(name)
    scheme, random = Scheme(cells), np.random.default_rng(3)
    old, new = flow_of(cells, (0, 0, 0), swirl(0.02)), flow_of(cells, bend(0.2), swirl(-0.01))
    constant = Transported(coefficients(cells, 0.7), still(cells), {"inlet": 0.7, "outlet": 0.7})
    any_one = [random.uniform(-1, 1, values.shape) for values in constant.values]
    for values, mean in zip(any_one, coefficients(cells, 0.1), strict=True):
        values[:, 0] = mean[:, 0] * random.uniform(-2, 3, len(values))
    bounded = scheme.limited(old.volumes, any_one, -0.3, 0.4)
    scalar = Transported(bounded, still(cells), {"inlet": 0.1, "outlet": None}, lambda _: (-0.3, 0.4))
    before = scheme.amount(old.volumes, scalar.values)
    size = 0.05
    assert scheme.step(size, old, new, scheme.balanced(size, old, new), [constant, scalar]) > 1
    assert np.abs(at_points(cells, constant.values) - 0.7).max() < 1e-11
    after, scale = scheme.amount(new.volumes, scalar.values), scheme.amount(old.volumes, coefficients(cells, 1.0))
    assert abs(after - before + sum(scalar.left.values())) < 1e-14 * scale
    assert min(abs(left) for left in scalar.left.values()) > 1e-4 * scale
    found = at_points(cells, scalar.values)
    assert -0.3 - 1e-12 < found.min() < found.max() < 0.4 + 1e-12
    assert np.ptp(found) > 0.1


def hill(z: Any) -> Any:
    """A profile along the pipe, whose ends it does not reach."""
    exponent = -(((z - 0.4 * L) / (0.11 * L)) ** 2)
    return ng.exp(exponent) if isinstance(z, ng.CoefficientFunction) else np.exp(exponent)


def carried(layers: int, order: int, steps: int, sway: float) -> float:
    """Return the error of a profile carried by a fifth of a pipe of flat faces, while the mesh sways along it."""
    geometry = TUBE.replace(mesh=COARSE.replace(axial_layers=layers, curving_order=1))
    cells = Cells(domain_of(geometry), order)
    scheme, time, speed = Scheme(cells), 1.0, 0.2 * L
    scalar = Transported(coefficients(cells, hill(ng.z)), still(cells), {"inlet": 0.0, "outlet": None})

    def flow(t: float) -> Flow:
        shape = sway * ng.sin(np.pi * ng.z / L)
        return flow_of(cells, (0, 0, np.sin(t) * shape), (0, 0, speed - np.cos(t) * shape))

    size, old = time / steps, flow(0.0)
    for k in range(1, steps + 1):
        new = flow(k * size)
        scheme.step(size, old, new, scheme.balanced(size, old, new), [scalar])
        old = new
    z = places(cells)[:, 2]
    z = z + np.sin(time) * sway * np.sin(np.pi * z / L)
    volumes = np.concatenate([v.ravel() for v in old.volumes])
    error = at_points(cells, scalar.values) - hill(z - speed * time)
    return float(np.sqrt(volumes @ error**2 / (volumes @ hill(z - speed * time) ** 2)))


@pytest.mark.parametrize(("order", "largest"), [(2, 2e-3), (3, 2e-4)])
def test_order_in_space(order: int, largest: float) -> None:
    """Third order, which is that of the stages in time whose size goes with that of the cells."""
    errors = [carried(layers, order, 4, 0.0) for layers in (12, 24)]
    assert errors[1] < largest
    assert 2.9 < np.log2(errors[0] / errors[1]) < 3.5


def test_order_in_time_on_a_moving_mesh() -> None:
    errors = [carried(16, 3, steps, 0.3 * L) for steps in (4, 8)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.25)


def diffused(cells: Cells) -> tuple[Scheme, Flow, Transported, float]:
    """Return cos(pi z / l) in a closed pipe of length l, after it has spread such that exp(-0.2) should be left of it,
    on a mesh that is bent along its axis; and its error."""
    scheme, stretch, diffusivity = Scheme(cells), 1.5, 2e-5
    still_blood = cells.sample(ng.CF((0, 0, 0)))
    motion = (stretch - 1) * ng.z + 0.1 * L * ng.sin(np.pi * ng.z / L)
    flow = Flow.of(cells, cells.sample(ng.CF((0, 0, motion))), still_blood, diffusive=True)
    scalar = Transported(coefficients(cells, ng.cos(np.pi / (stretch * L) * (ng.z + motion))), still(cells), {},
                         diffusivity=diffusivity)  # fmt: skip
    time = 0.2 / (diffusivity * (np.pi / (stretch * L)) ** 2)
    scheme.step(time, flow, flow, scheme.balanced(time, flow, flow), [scalar])
    z = places(cells)[:, 2]
    z = stretch * z + 0.1 * L * np.sin(np.pi * z / L)
    error = at_points(cells, scalar.values) - np.exp(-0.2) * np.cos(np.pi * z / (stretch * L))
    return scheme, flow, scalar, float(np.sqrt(np.mean(error**2)))


def test_order_of_diffusion() -> None:
    """Third order with polynomials of second order."""
    errors = []
    for layers in (2, 4):
        geometry = TUBE.replace(mesh=COARSE.replace(axial_layers=layers, curving_order=1))
        errors.append(diffused(Cells(domain_of(geometry), 2))[-1])
    assert errors[1] < 2e-3
    assert 2.7 < np.log2(errors[0] / errors[1]) < 3.3


def test_diffusion_keeps_amounts_and_constants() -> None:
    """On a mesh that moves."""
    cells = cells_of("mixed")
    scheme, flow, scalar, _ = diffused(cells)
    moved = Flow.of(cells, cells.sample(ng.CF(bend(0.2))), cells.sample(ng.CF((0, 0, 0))), diffusive=True)
    constant = Transported(coefficients(cells, 0.7), still(cells), {}, diffusivity=2e-5)
    before, scale = (scheme.amount(flow.volumes, one) for one in (scalar.values, coefficients(cells, 1.0)))
    scheme.step(0.01, flow, moved, scheme.balanced(0.01, flow, moved), [scalar, constant])
    assert np.abs(at_points(cells, constant.values) - 0.7).max() < 1e-11
    left = sum(scalar.left.values())
    assert abs(left) > 1e-3 * scale
    assert abs(scheme.amount(moved.volumes, scalar.values) + left - before) < 1e-13 * scale


@pytest.mark.parametrize("name", MESHES)
def test_diffusion_is_symmetric_and_smooths(name: str) -> None:
    """Between any two fields, on bent cells."""
    cells, random = cells_of(name), np.random.default_rng(5)
    scheme = Scheme(cells)
    flow = Flow.of(cells, cells.sample(ng.CF(bend(0.2))), cells.sample(ng.CF((0, 0, 0))), diffusive=True)
    fields = [[random.uniform(-1, 1, c.shape) for c in coefficients(cells, 1.0)] for _ in range(2)]

    def rate_of(one: list[Array]) -> list[Array]:
        traces = [(c @ b.element.face_values.T).ravel() for b, c in zip(cells.blocks, one, strict=True)]
        return scheme._diffusion(flow, one, np.concatenate(traces))

    def work(one: list[Array], other: list[Array]) -> float:
        return sum(float(np.sum(a * b)) for a, b in zip(rate_of(one), other, strict=True))

    a, b = fields
    scale = -work(a, a)
    assert scale > 0
    assert work(a, b) == pytest.approx(work(b, a), abs=1e-12 * scale)
