"""The laws there are: a new law is one file and one line here."""

from __future__ import annotations

from ngfsi.materials.fluid.newtonian import Newtonian
from ngfsi.materials.law import Law
from ngfsi.materials.solid.compressible_neo_hookean import CompressibleNeoHookean
from ngfsi.materials.solid.hencky import Hencky
from ngfsi.materials.solid.law import SolidLaw
from ngfsi.materials.solid.mooney_rivlin import MooneyRivlin
from ngfsi.materials.solid.neo_hookean import NeoHookean
from ngfsi.materials.solid.saint_venant_kirchhoff import SaintVenantKirchhoff

SOLID_LAWS: tuple[type[SolidLaw], ...] = (
    MooneyRivlin,
    NeoHookean,
    SaintVenantKirchhoff,
    CompressibleNeoHookean,
    Hencky,
)
FLUID_LAWS: tuple[type[Law], ...] = (Newtonian,)


def laws() -> dict[str, type[Law]]:
    """Return every law by its tag."""
    return {cls.model_fields["law"].default: cls for cls in (*SOLID_LAWS, *FLUID_LAWS)}
