"""The blood's and the mesh's fields as functions of the unknowns and their rates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import ngsolve as ng

MOTION, VELOCITY, PRESSURE, STRETCH = "motion", "velocity", "pressure", "stretch"
"""Names of the unknown fields: displacement of solids and mesh, velocity of the blood relative to the mesh, pressure of
the blood relative to the reference of its vessel, and, in plane stress, the change of the stretch across the plane."""

Named = Mapping[str, Any]
"""Field -> its trial or test function, or its grid function."""


@dataclass(frozen=True)
class Fields:
    """Coefficient functions of the unknowns: of trial functions or of a state.

    Attributes:
        motion, grad_motion: displacement m of the mesh and its reference gradient.
        grad_motion_rate: reference gradient of the mesh's velocity.
        relative: velocity w of the blood relative to the mesh.
        velocity, grad_velocity: u = w + rate of m, and its reference gradient.
        acceleration: rate of u at a fixed reference point.
        pressure: that of the blood, relative to the reference of its vessel.
    """

    motion: Any
    grad_motion: Any
    grad_motion_rate: Any
    relative: Any
    velocity: Any
    grad_velocity: Any
    acceleration: Any
    pressure: Any

    @classmethod
    def of(cls, parts: Named, velocity_history: Named, acceleration_history: Named, new: Any) -> Fields:
        """Return the fields for rates that are linear in the unknowns: rate(y) = new y + history."""
        m, w, p = (parts[name] for name in (MOTION, VELOCITY, PRESSURE))
        hm, hw, am = velocity_history[MOTION], velocity_history[VELOCITY], acceleration_history[MOTION]
        u, grad_rate = w + new * m + hm, new * ng.Grad(m) + ng.Grad(hm)
        grad_u = ng.Grad(w) + new * ng.Grad(m) + ng.Grad(hm)
        return cls(m, ng.Grad(m), grad_rate, w, u, grad_u, acceleration=new * u + hw + am, pressure=p)
