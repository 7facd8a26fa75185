"""Material laws, one per file, and published parameter sets."""

from ngfsi.materials.compressible_neo_hookean import CompressibleNeoHookean
from ngfsi.materials.from_case import FluidMaterial, SolidMaterial
from ngfsi.materials.hencky import Hencky
from ngfsi.materials.law import Law, SolidLaw
from ngfsi.materials.mooney_rivlin import MooneyRivlin
from ngfsi.materials.neo_hookean import NeoHookean
from ngfsi.materials.newtonian import Newtonian
from ngfsi.materials.parameter_sets import ParameterSet, available_sets, load_set, read_set
from ngfsi.materials.registry import FLUID_LAWS, SOLID_LAWS
from ngfsi.materials.saint_venant_kirchhoff import SaintVenantKirchhoff
from ngfsi.materials.table import Row, table

__all__ = [
    "FLUID_LAWS",
    "SOLID_LAWS",
    "CompressibleNeoHookean",
    "FluidMaterial",
    "Hencky",
    "Law",
    "MooneyRivlin",
    "NeoHookean",
    "Newtonian",
    "ParameterSet",
    "Row",
    "SaintVenantKirchhoff",
    "SolidLaw",
    "SolidMaterial",
    "available_sets",
    "load_set",
    "read_set",
    "table",
]
