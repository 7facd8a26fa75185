"""The curved reference shape as a displacement of the straight mesh.

Netgen curves an element with prismatic or hexahedral shape differently at different integration rules (6.2.2608: points
evaluated in a batch leave the element's straight faces), so that neighbours overlap by parts in 1e4. A closed lumen
under 10 mmHg turns such gaps into spurious flow of the size of the real one. The mesh therefore stays straight, and
the shape is a continuous displacement of the polynomial order wanted: on curved boundaries where Netgen's geometry has
them, inside by the finite elements' own continuation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array, Numbers

EDGE_FACTOR = -8.0
"""NGSolve's function of second order on an edge is -1/8 in the edge's middle."""
QUAD_FACTOR = EDGE_FACTOR**2
"""And that on a quadrilateral the product of two such."""


@dataclass(frozen=True)
class EdgeBulges:
    """A shape that is quadratic on each edge, as of second-order cells, and on faces of four edges if they have nodes.

    Attributes:
        edges: numbers of their vertices, the smaller first, shape (n, 2).
        bulges: way from the middle of the straight edge to that of the curved one, shape (n, 3) [m].
        quads: numbers of the corners of faces with a node in the middle, in ascending order, shape (m, 4).
        quad_bulges: way to that node from where the edges alone would have it, shape (m, 3) [m].
    """

    edges: Numbers
    bulges: Array
    quads: Numbers = field(default_factory=lambda: np.zeros((0, 4), dtype=np.int64))
    quad_bulges: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def on(self, space: Any) -> Any:
        """Return the displacement as a grid function of a vector-valued H1 space of order 2 or more."""
        shape = ng.GridFunction(space)
        for nodes, bulges, sides, kind, factor in (
            (self.edges, self.bulges, space.mesh.edges, ng.EDGE, EDGE_FACTOR),
            (self.quads, self.quad_bulges, space.mesh.faces if len(self.quads) else (), ng.FACE, QUAD_FACTOR),
        ):
            numbers = {tuple(corners): k for k, corners in enumerate(nodes.tolist())}
            for side in sides:
                number = numbers.get(tuple(sorted(vertex.nr for vertex in side.vertices)))
                if number is not None:
                    dofs = np.reshape(space.GetDofNrs(ng.NodeId(kind, side.nr)), (len(bulges[number]), -1))
                    for dof, value in zip(dofs[:, 0], bulges[number], strict=True):
                        shape.vec[int(dof)] = factor * float(value)
        return shape


@dataclass(frozen=True)
class BoundaryMotion:
    """A displacement [m] of boundaries across z, in the coordinates of the curved mesh; the mesh between follows.

    It follows as an elastic solid that is the stiffer the smaller the elements: by Laplace's equation elements between
    bodies that move apart turn inside out, with equal stiffness small ones beside large ones.

    Attributes:
        by_name: boundary -> displacement; boundaries that share an edge must agree there.
        steps: in which the boundaries move, each on the mesh as the one before left it: more for large ones.
        straight: whether the displacement is that of the straight mesh, which has no geometry.
    """

    by_name: Mapping[str, ng.CoefficientFunction]
    steps: int = 1
    straight: bool = False

    def on(self, space: Any) -> Any:
        """Return the displacement as a grid function of a vector-valued H1 space in three dimensions."""
        whole, motion = ng.GridFunction(space), ng.GridFunction(space)
        given = ng.BitArray(space.ndof)
        given[:] = False
        for name, displacement in self.by_name.items():
            _on_boundaries(whole, [name], displacement)
            given |= space.GetDofs(ng.Region(space.mesh, ng.BND, name))
        given[space.ndof // 3 * 2 : space.ndof] = True  # z
        trial, test = space.TnT()
        strain = ng.Grad(trial) + ng.Grad(trial).trans
        work = ng.InnerProduct(strain, ng.Grad(test)) / ng.specialcf.mesh_size**2
        for _ in range(self.steps):
            if self.steps > 1:
                space.mesh.SetDeformation(motion)
            stiffness = ng.BilinearForm(work * ng.dx, symmetric=True).Assemble().mat
            if self.steps > 1:
                space.mesh.UnsetDeformation()
            inverse = stiffness.Inverse(~given, inverse="sparsecholesky")
            step = ((1 / self.steps) * whole.vec).Evaluate()
            step.data -= inverse @ stiffness * step
            motion.vec.data += step
        return motion


ShapeMap: TypeAlias = ng.CoefficientFunction | EdgeBulges | BoundaryMotion
"""From the curved mesh to the reference shape."""


def reference_shape(mesh: Any, boundaries: Sequence[str], order: int, shape_map: ShapeMap | None) -> Any:
    """Return the displacement [m] from the straight mesh to the reference shape, a grid function.

    Args:
        mesh: NGSolve mesh with its geometry; straight and without deformation afterwards.
        boundaries: all names; where two meet, the rim follows the first of them.
        order: polynomial order of the shape.
        shape_map: displacement of the curved shape, in its coordinates, that follows the curving; that of edges stands
            in its place.
    """
    space = ng.VectorH1(mesh, order=order)
    if isinstance(shape_map, EdgeBulges):
        # Netgen would curve a mesh without a geometry along that of whatever mesh was there before
        return shape_map.on(space)
    if isinstance(shape_map, BoundaryMotion) and shape_map.straight:
        return shape_map.on(space)
    position = ng.CF((ng.x, ng.y, ng.z)[: mesh.dim])
    mesh.Curve(order)
    shape = _on_boundaries(ng.GridFunction(space), boundaries, position)
    mesh.Curve(1)
    shape.vec.data -= _on_boundaries(ng.GridFunction(space), boundaries, position).vec
    if shape_map is not None:
        mesh.SetDeformation(shape)
        if isinstance(shape_map, BoundaryMotion):
            moved = shape_map.on(space)
        else:
            moved = ng.GridFunction(space)
            moved.Set(shape_map)
            _on_boundaries(moved, boundaries, shape_map)
        mesh.UnsetDeformation()
        shape.vec.data += moved.vec
    return shape


def _on_boundaries(values: Any, boundaries: Sequence[str], field: ng.CoefficientFunction) -> Any:
    """Return a grid function with the values of a field on boundaries, projected onto each by itself: a projection over
    all would be averaged along their rims."""
    space, part = values.space, ng.GridFunction(values.space)
    for name in reversed(boundaries):
        boundary = ng.Region(space.mesh, ng.BND, name)
        part.Set(field, definedon=boundary)
        ng.Projector(space.GetDofs(boundary), False).Project(values.vec)
        values.vec.data += part.vec
    return values
