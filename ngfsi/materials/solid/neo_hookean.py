"""Neo-Hookean solid with a volumetric term whose modulus is read in two ways."""

from __future__ import annotations

from typing import ClassVar, Literal

from ngsolve import log
from pydantic import Field

from ngfsi.materials.solid.law import Invariants, IsotropicLaw, Pair
from ngfsi.units import Pressure


class NeoHookean(IsotropicLaw):
    """W = C10 (I1 - 3) + k [(J^2 - 1)/2 - ln J] in the isochoric invariant, with initial bulk modulus 2 k.

    The literature prints the formula with k = Kv and calls Kv the initial bulk modulus, which cannot both hold, so
    the reading has to be chosen: `volumetric = "K=2Kv"` takes the formula literally (k = Kv), `"K=Kv"` takes the
    name literally (k = Kv/2).
    """

    formula: ClassVar[str] = (
        r"W = C_{10}(\bar I_1 - 3) + k\left[\tfrac{1}{2}(J^2 - 1) - \ln J\right],\quad k = K_v\ \text{or}\ K_v/2"
    )
    source: ClassVar[str] = "S. Avril et al., J Biomech Eng 132 (2010) 031006, as quoted by later work"

    law: Literal["neo_hookean"] = "neo_hookean"
    C10: Pressure = Field(gt=0)
    """Half of the shear modulus."""
    Kv: Pressure = Field(gt=0)
    """Bulk modulus."""
    volumetric: Literal["K=Kv", "K=2Kv"]
    """Form of the volumetric energy."""

    def energies_of(self, strain: Invariants) -> Pair:
        I1, J = strain.isochoric[0], strain.J
        return self.C10 * (I1 - 3), self.bulk_modulus / 2 * ((J * J - 1) / 2 - log(J))

    @property
    def shear_modulus(self) -> float:
        return 2 * self.C10

    @property
    def bulk_modulus(self) -> float:
        return self.Kv if self.volumetric == "K=Kv" else 2 * self.Kv
