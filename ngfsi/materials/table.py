"""The parameter sets in a table: what they amount to at small strain, and what is odd about them."""

from __future__ import annotations

from dataclasses import dataclass

from ngfsi.materials.fluid.law import FluidLaw
from ngfsi.materials.parameter_sets import ParameterSet, available_sets, read_set
from ngfsi.materials.solid.law import SolidLaw

MISMATCH = 0.01
"""Relative difference from which a stated modulus counts as another one."""


@dataclass(frozen=True)
class Row:
    """One parameter set; what does not apply is None."""

    name: str
    title: str
    law: str
    source: str
    remark: str
    density: float
    """kg/m3"""
    shear_modulus: float | None
    """Initial, Pa"""
    bulk_modulus: float | None
    """Initial, Pa"""
    youngs_modulus: float | None
    """Initial, Pa"""
    poissons_ratio: float | None
    viscosity: float | None
    """Pa s"""
    flags: tuple[str, ...]
    """What is odd, a phrase each."""


def table() -> list[Row]:
    """Return one row per parameter set, sorted by name."""
    return [_row(read_set(name)) for name in available_sets()]


def _row(entry: ParameterSet) -> Row:
    material = entry.material
    solid = material if isinstance(material, SolidLaw) else None
    return Row(
        name=entry.name,
        title=entry.title,
        law=material.law,
        source=entry.source,
        remark=entry.remark,
        density=material.density,
        shear_modulus=solid.shear_modulus if solid else None,
        bulk_modulus=solid.bulk_modulus if solid else None,
        youngs_modulus=solid.youngs_modulus if solid else None,
        poissons_ratio=solid.poissons_ratio if solid else None,
        viscosity=material.nominal_viscosity if isinstance(material, FluidLaw) else None,
        flags=_flags(entry, solid) if solid else (),
    )


def _flags(entry: ParameterSet, law: SolidLaw) -> tuple[str, ...]:
    flags = ["negative Poisson ratio"] if (law.poissons_ratio or 0.0) < 0 else []
    for name in type(entry.stated).model_fields:
        stated, actual = getattr(entry.stated, name), getattr(law, name)
        if stated is not None and abs(stated - actual) > MISMATCH * actual:
            words = name.replace("youngs", "Young's").replace("_", " ")
            flags.append(f"stated {words} {stated / 1e3:.4g} kPa is not the initial {words} {actual / 1e3:.4g} kPa")
    return tuple(flags)
