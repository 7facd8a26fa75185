"""How far a system's elements are moved and deformed, at their quadrature points, and what is close to failing."""

from __future__ import annotations

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array, Numbers
from ngfsi.materials.solid.fibres import Fibred
from ngfsi.measure.ellipticity import (
    Ellipticity,
    EllipticityInAllDirections,
    determinants,
    extreme,
    principal_stretches,
)
from ngfsi.measure.points import Points
from ngfsi.physics.integrals import form_rules
from ngfsi.physics.kinematics import Kinematics, in_3d
from ngfsi.system.system import System
from ngfsi.system.together import OnAllRanks, together
from ngfsi.units import in_unit

CLOSE = 0.2
"""det F below which elements are said to be close to inversion."""


class Deformation(OnAllRanks):
    """Displacement, volume ratio det F and stability of the materials of a system's present state."""

    def __init__(self, system: System) -> None:
        super().__init__(system)
        domain, motion = system.domain, system.motion
        self._solids = domain.geometry.solids
        F = Kinematics(ng.Grad(motion)).F
        # one pass through the elements for both
        self._motion_and_F = ng.CF((*(motion[i] for i in range(domain.mesh.dim)), in_3d(F, 1.0))).Compile()
        prestressed = system.stress_free_gradient() is not None
        self._strain = in_3d(system.deformation_gradient(), 1.0) if prestressed else None
        self._laws = {name: system.case.materials.law_of(name) for name in self._solids}
        self._resistance = {
            name: Ellipticity(law) for name, law in self._laws.items() if law.isotropic and not law.varying
        }
        at_rest = {name: model.at_rest for name, model in system.solids.items()}
        self._fibred = {
            name: model for name, model in at_rest.items() if isinstance(model, Fibred) and not self._laws[name].varying
        }
        self._in_all = {name: EllipticityInAllDirections(model.law) for name, model in self._fibred.items()}
        points = form_rules(system.unknowns.order)
        self._place = ng.CF((ng.x, ng.y, ng.z)[: domain.mesh.dim]) + motion
        self._lumens = domain.lumens
        self._warned: set[str] = set()
        self._points = {name: Points.of(system, domain.materials(name), points) for name in domain.regions}
        self._motion = motion
        self._known: dict[str, tuple[float, Array]] = {}
        self._known_of = np.zeros(0)
        self._evaluated: dict[str, Array] = {}
        self._evaluated_of = np.zeros(0)

    def smallest_jacobian(self, region: str) -> float:
        """Return the smallest det F of a region."""
        return self._smallest(region)[0]

    def min_jacobian(self, region: str) -> tuple[float, str]:
        """Return the smallest det F of a region and the deformed place where it is, in words."""
        smallest, place = self._smallest(region)
        return smallest, in_unit(place, "mm", ".3g")

    def _smallest(self, region: str) -> tuple[float, Array]:
        """Return the smallest det F of a region and the deformed place (m) where it is, computed once per state."""
        state = self._motion.vec.FV().NumPy()
        if not np.array_equal(state, self._known_of):
            self._known, self._known_of = self._smallest_of_all(), state.copy()
        return self._known[region]

    @together
    def _smallest_of_all(self) -> dict[str, tuple[float, Array]]:
        found = [self._least(name, determinants(self._gradients(name))) for name in self._points]
        values, places = self.system.ranks.smallest(*map(np.array, zip(*found, strict=True)))
        return {name: (float(value), place) for name, value, place in zip(self._points, values, places, strict=True)}

    def _least(self, region: str, values: Array, chosen: Numbers | None = None) -> tuple[float, Array]:
        """Return the smallest of some values and the deformed place (m) where it is, infinite where there are none.

        Args:
            values: at this rank's points of a region, or at chosen ones.
        """
        if len(values) == 0:
            return np.inf, np.zeros(self.system.domain.mesh.dim)
        number = int(np.argmin(values))
        there = self._points[region].at[[number if chosen is None else chosen[number]]]
        return float(values[number]), np.ravel(self._place(there))

    @together
    def largest_displacement(self) -> float:
        """Return the largest displacement (m) of the solids."""
        dim = self.system.domain.mesh.dim
        squares = [np.max(np.sum(self._values(name)[:, :dim] ** 2, axis=1), initial=0.0) for name in self._solids]
        return -float(self.system.ranks.smallest(-np.sqrt([max(squares)]))[0][0])

    def _values(self, region: str) -> Array:
        """Return displacement (m) and F at this rank's points of a region, (n, dim + 9), computed once per state."""
        state = self._motion.vec.FV().NumPy()
        if not np.array_equal(state, self._evaluated_of):
            self._evaluated, self._evaluated_of = {}, state.copy()
        if region not in self._evaluated:
            self._evaluated[region] = self._points[region].values(self._motion_and_F)
        return self._evaluated[region]

    def _gradients(self, region: str) -> Array:
        """Return F (n, 3, 3) at this rank's points of a region."""
        return self._values(region)[:, -9:].reshape(-1, 3, 3)

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
        resistance, place = self._smallest_resistance(region)
        if resistance > 0:
            return ""
        return (
            f"the material of '{region}' near {in_unit(place, 'mm', '.3g')} has lost strong ellipticity: "
            f"{self._laws[region].law} does not resist shear bands there any more"
        )

    @together
    def _smallest_resistance(self, region: str) -> tuple[float, Array]:
        """Return the smallest resistance to shear bands, among each rank's extreme points, and the place (m) of it."""
        points = self._points[region]
        F = self._gradients(region) if self._strain is None else points.values(self._strain).reshape(-1, 3, 3)
        chosen, resistances = np.zeros(0, dtype=np.int64), np.zeros(0)
        if len(F):
            stretches = principal_stretches(F)
            chosen = extreme(stretches)
            if region in self._in_all:
                ways = [points.values(one) for one in self._fibred[region].directions]
                resistances = self._in_all[region].smallest(F[chosen], np.stack(ways, axis=1)[chosen])
            else:
                resistances = self._resistance[region].smallest(stretches[chosen])
        smallest, place = self._least(region, resistances, chosen)
        values, places = self.system.ranks.smallest(np.array([smallest]), place[None])
        return float(values[0]), places[0]

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
