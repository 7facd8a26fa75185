"""How far a system's elements are moved and deformed, at their quadrature points, and what is close to failing."""

from __future__ import annotations

import ngsolve as ng
import numpy as np

from ngfsi.materials.solid.fibres import Fibred
from ngfsi.measure.ellipticity import Ellipticity, EllipticityInAllDirections, extreme, principal_stretches
from ngfsi.physics.integrals import rules
from ngfsi.physics.kinematics import Kinematics, in_3d
from ngfsi.system.system import System
from ngfsi.units import in_unit

CLOSE = 0.2
"""det F below which elements are said to be close to inversion."""


class Deformation:
    """Displacement, volume ratio det F and stability of the materials of a system's present state."""

    def __init__(self, system: System) -> None:
        domain, motion = system.domain, system.motion
        self._solids = domain.geometry.solids
        k = Kinematics(ng.Grad(motion))
        self._size, self._J = ng.Norm(motion).Compile(), k.J.Compile()
        self._strain = in_3d(system.deformation_gradient(), 1.0)
        self._laws = {name: system.case.materials.law_of(name) for name in self._solids}
        self._resistance = {
            name: Ellipticity(law) for name, law in self._laws.items() if law.isotropic and not law.varying
        }
        at_rest = {name: model.at_rest for name, model in system.solids.items()}
        self._fibred = {
            name: model for name, model in at_rest.items() if isinstance(model, Fibred) and not self._laws[name].varying
        }
        self._in_all = {name: EllipticityInAllDirections(model.law) for name, model in self._fibred.items()}
        points = rules(2 * system.unknowns.order)
        self._place = ng.CF((ng.x, ng.y, ng.z)[: domain.mesh.dim]) + motion
        self._lumens = domain.lumens
        self._warned: set[str] = set()
        self._points = {name: domain.mesh.MapToAllElements(points, domain.materials(name)) for name in domain.regions}
        self._motion = motion
        self._known: dict[str, tuple[float, int]] = {}
        self._known_of = np.zeros(0)

    def smallest_jacobian(self, region: str) -> float:
        """Return the smallest det F of a region."""
        return self._smallest(region)[0]

    def min_jacobian(self, region: str) -> tuple[float, str]:
        """Return the smallest det F of a region and the deformed place where it is, in words."""
        smallest, number = self._smallest(region)
        return smallest, self._deformed_place(region, number)

    def _smallest(self, region: str) -> tuple[float, int]:
        """Return the smallest det F of a region and the number of the point where it is, computed once per state."""
        state = self._motion.vec.FV().NumPy()
        if not np.array_equal(state, self._known_of):
            self._known, self._known_of = {}, state.copy()
        if region not in self._known:
            values = np.ravel(self._J(self._points[region]))
            number = int(np.argmin(values))
            self._known[region] = float(values[number]), number
        return self._known[region]

    def largest_displacement(self) -> float:
        """Return the largest displacement (m) of the solids."""
        return max(float(np.max(self._size(self._points[name]))) for name in self._solids)

    def inversion(self) -> str:
        """Say in which region and where an element is turned inside out, or nothing."""
        for region in self._points:
            if not self.smallest_jacobian(region) > 0:
                smallest, place = self.min_jacobian(region)
                what = "the mesh of the blood is folded" if region in self._lumens else f"elements of '{region}' invert"
                return f"{what} near {place} (det F {smallest:.3g})"
        return ""

    def approaching(self) -> list[str]:
        """Return warnings of regions that came close to inversion, or lost strong ellipticity, since the last call."""
        warnings = {}
        for name in self._points:
            if self.smallest_jacobian(name) < CLOSE:
                J, place = self.min_jacobian(name)
                text = f"elements of '{name}' near {place} are close to inversion, det F {J:.3g}"
                warnings[f"inversion of {name}"] = text
        for name in self._solids:
            if name not in self._resistance and name not in self._in_all:
                text = (
                    f"strong ellipticity of '{name}' is not checked: that is done for isotropic laws and for ngfsi's "
                    "laws with fibres, of moduli that do not vary"
                )
                warnings[f"ellipticity of {name}"] = text
            if f"stability of {name}" not in self._warned and (unstable := self.unstable(name)):
                warnings[f"stability of {name}"] = f"{unstable}: what is computed from here on depends on the mesh"
        new = [sentence for what, sentence in warnings.items() if what not in self._warned]
        self._warned |= set(warnings)
        return new

    def unstable(self, region: str) -> str:
        """Say where the material of a solid has lost strong ellipticity (see `Ellipticity`), or nothing."""
        if region not in self._resistance and region not in self._in_all:
            return ""
        F = np.asarray(self._strain(self._points[region])).reshape(-1, 3, 3)
        stretches = principal_stretches(F)
        chosen = extreme(stretches)
        if region in self._in_all:
            ways = [np.asarray(one(self._points[region])).reshape(-1, 3) for one in self._fibred[region].directions]
            directions = np.stack([np.broadcast_to(way, (len(F), 3)) for way in ways], axis=1)
            resistances = self._in_all[region].smallest(F[chosen], directions[chosen])
        else:
            resistances = self._resistance[region].smallest(stretches[chosen])
        if np.min(resistances) > 0:
            return ""
        place = self._deformed_place(region, int(chosen[np.argmin(resistances)]))
        return (
            f"the material of '{region}' near {place} has lost strong ellipticity: "
            f"{self._laws[region].law} does not resist shear bands there any more"
        )

    def diagnose_failure(self, begun: bool) -> str:
        """Say what in the last good state may be the end of a run, and where: to be added to a sentence.

        Args:
            begun: whether any step was taken, so that the loads have changed something.
        """
        found = {region: self.min_jacobian(region) for region in self._points}
        region = min(found, key=lambda name: found[name][0])
        smallest, place = found[region]
        sentence = f"; in the last good state the smallest det F is {smallest:.3g}, in '{region}' near {place}"
        if lost := [said for name in self._solids if (said := self.unstable(name))]:
            return f"{sentence}, and {', and '.join(lost)}"
        if smallest <= CLOSE:
            return sentence
        if begun:
            what = "the vein" if self._lumens else "the shape"
            return f"{sentence}: no element is close to inversion, {what} may have lost its stability"
        return f"{sentence}: no step was taken, the loads of the first one may be too large or jump"

    def _deformed_place(self, region: str, number: int) -> str:
        points = self._points[region]
        place = np.asarray(self._place(points)).reshape(len(points), -1)[number]
        return in_unit(place, "mm", ".3g")
