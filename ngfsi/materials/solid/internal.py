"""Internal variables of solids: fields whose new values follow from the deformation as a step begins."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import ngsolve as ng
from ngsolve import CoefficientFunction, GridFunction, InnerProduct

if TYPE_CHECKING:
    from ngfsi.materials.solid.law import Place

SHAPES = (ng.TRIG, ng.QUAD, ng.TET, ng.PRISM, ng.HEX, ng.PYRAMID)


class InternalVariable:
    """A field that a solid remembers, discontinuous between elements.

    Attributes:
        field: its values at the start of the step; of an L2 space of the solid's region.
        new: those at the end of the step, of which the projection onto the space is taken over.
    """

    def __init__(self, field: GridFunction, new: CoefficientFunction, place: Place) -> None:
        """Prepare.

        Args:
            new: a function of fields of the same model, of `Place.F`, `before`, `rate` and `step`.
            place: of the model.
        """
        self.field, self.new = field, new
        space = field.space
        self._region = place.mesh.Materials(place.region)
        # a rule of its own: the one that NGSolve chooses for derivatives is another
        rules = {shape: ng.IntegrationRule(shape, 2 * space.globalorder) for shape in SHAPES}
        self.measure = ng.dx(definedon=self._region, intrules=rules)
        self._right = ng.LinearForm(space)
        self._right += InnerProduct(new, space.TestFunction()).Compile() * self.measure

    def updated(self) -> Any:
        """Return the vector of the new values; overwritten later."""
        self._right.Assemble()
        return self.projected(self._right.vec)

    def projected(self, products: Any) -> Any:
        """Return the function whose products with the space's functions are given, in their place."""
        self.field.space.SolveM(products, definedon=self._region)
        return products
