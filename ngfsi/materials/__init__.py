"""Material laws, one per file, and published parameter sets."""

from ngfsi.materials.fluid.newtonian import Newtonian
from ngfsi.materials.from_case import FluidMaterial, SolidMaterial
from ngfsi.materials.law import Law
from ngfsi.materials.parameter_sets import ParameterSet, available_sets, load_set, read_set
from ngfsi.materials.solid.compressible_neo_hookean import CompressibleNeoHookean
from ngfsi.materials.solid.hencky import Hencky
from ngfsi.materials.solid.law import SolidLaw
from ngfsi.materials.solid.mooney_rivlin import MooneyRivlin
from ngfsi.materials.solid.neo_hookean import NeoHookean
from ngfsi.materials.solid.ogden import Ogden
from ngfsi.materials.solid.saint_venant_kirchhoff import SaintVenantKirchhoff

__all__ = [
    "CompressibleNeoHookean", "FluidMaterial", "Hencky", "Law", "MooneyRivlin", "NeoHookean", "Newtonian", "Ogden",
    "ParameterSet", "SaintVenantKirchhoff", "SolidLaw", "SolidMaterial", "available_sets", "load_set",
    "read_set",
]  # fmt: skip
