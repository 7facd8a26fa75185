"""Integration points at which fields are measured: on several ranks each has those of its own elements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import ngsolve as ng
import numpy as np

from ngfsi.arrays import Array, Mask
from ngfsi.mesh.domain import Domain
from ngfsi.system.system import System


def joined(parts: Sequence[tuple[Mask, Array]]) -> Array:
    """Return the values at all points of a region, of which each rank has its own; none of no rank."""
    if not parts:
        return np.zeros(0)
    whole = np.empty((len(parts[0][0]), *parts[0][1].shape[1:]))
    for mine, values in parts:
        whole[mine] = values
    return whole


class Points:
    """Integration points of this rank's elements in a region of the mesh or of its boundary.

    Attributes:
        at: NGSolve's points.
        mine: which of all points of the region they are, element by element.
    """

    def __init__(
        self, domain: Domain, region: Any, rules: Mapping[Any, ng.IntegrationRule], mine: ng.BitArray | None = None
    ) -> None:
        """Prepare.

        Args:
            rules: for each shape of element.
            mine: this rank's elements of the mesh, or of its boundary if the region is one; default: all.
        """
        mesh, elements = domain.mesh, list(region.Elements())
        sizes = [len(rules[element.type]) for element in elements]
        self.mine = np.repeat([mine is None or mine[element.nr] for element in elements], sizes)
        self.at = mesh.MapToAllElements(dict(rules), region)[self.mine]
        weights = {shape: np.array(rule.weights) for shape, rule in rules.items()}
        of_rules = np.concatenate([np.zeros(0), *(weights[element.type] for element in elements)])[self.mine]
        inside = region.VB() == ng.VOL
        jacobian = ng.specialcf.JacobianMatrix(mesh.dim, mesh.dim - (not inside))
        squared = ng.Det(jacobian.trans * jacobian)
        self._weights = of_rules * np.sqrt(self.values(squared)[:, 0])

    @classmethod
    def of(cls, system: System, region: Any, rules: Mapping[Any, ng.IntegrationRule]) -> Points:
        """Return those of a system's rank."""
        return cls(system.domain, region, rules, system.mine(region.VB()))

    def values(self, field: Any) -> Array:
        """Return the values (points, components) of a field."""
        if len(self.at) == 0:
            return np.zeros((0, field.dim))
        return np.asarray(field(self.at)).reshape(len(self.at), -1)

    def integrals(self, field: Any) -> Array:
        """Return the integrals (components,) of a field over this rank's elements of the reference shape."""
        return np.asarray(self._weights @ self.values(field))
