"""How far a system's elements are moved and deformed, at their quadrature points."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from ngfsi.physics.kinematics import Kinematics
from ngfsi.solve.forms import rules
from ngfsi.solve.system import System
from ngfsi.units import from_si

SHOWN = "mm"

CLOSE = 0.2
"""det F below which elements are said to be close to inversion."""


def _in_mm(place: NDArray[np.float64]) -> str:
    return f"({', '.join(f'{from_si(float(x), SHOWN):.3g}' for x in place)}) {SHOWN}"


class Deformation:
    """Displacement and volume ratio det F of a system's present state."""

    def __init__(self, system: System) -> None:
        domain, motion = system.domain, system.state.components[0]
        self._solids = domain.geometry.solids
        self._size, self._J = ng.Norm(motion).Compile(), Kinematics(ng.Grad(motion)).J.Compile()
        points = rules(2 * system.unknowns.order)
        self._place = ng.CF((ng.x, ng.y, ng.z)[: domain.mesh.dim]) + motion
        self._fluid = domain.geometry.fluid
        self._warned: set[str] = set()
        self._points = {name: domain.mesh.MapToAllElements(points, domain.materials(name)) for name in domain.regions}

    def smallest_jacobian(self, region: str) -> float:
        """Return the smallest det F of a region."""
        return float(np.min(self._J(self._points[region])))

    def largest_displacement(self) -> float:
        """Return the largest displacement (m) of the solids."""
        return max(float(np.max(self._size(self._points[name]))) for name in self._solids)

    def inversion(self) -> str:
        """Say in which region and where an element is turned inside out, or nothing."""
        for region in self._points:
            if not self.smallest_jacobian(region) > 0:
                smallest, place = self.worst(region)
                what = "the mesh of the blood is folded" if region == self._fluid else f"elements of '{region}' invert"
                return f"{what} near {place} (det F {smallest:.3g})"
        return ""

    def approaching(self) -> list[str]:
        """Return a warning for each region that has come close to inversion since the last call."""
        unknown = [region for region in self._points if region not in self._warned]
        close = {region: self.worst(region) for region in unknown if self.smallest_jacobian(region) < CLOSE}
        self._warned |= set(close)
        return [
            f"elements of '{name}' near {place} are close to inversion, det F {J:.3g}"
            for name, (J, place) in close.items()
        ]

    def narrowest(self) -> str:
        """Say in which region, and where, elements are closest to inversion: to be added to a sentence."""
        found = {region: self.worst(region) for region in self._points}
        region = min(found, key=lambda name: found[name][0])
        smallest, place = found[region]
        sentence = f"; in the last good state the smallest det F is {smallest:.3g}, in '{region}' near {place}"
        if smallest > CLOSE:
            return f"{sentence}: no element is close to inversion, the vein may have lost its stability"
        return sentence

    def worst(self, region: str) -> tuple[float, str]:
        """Return the smallest det F of a region and the deformed place where it is, in words."""
        values = np.ravel(self._J(self._points[region]))
        number = int(np.argmin(values))
        place = np.asarray(self._place(self._points[region])).reshape(len(values), -1)[number]
        return float(values[number]), _in_mm(place)
