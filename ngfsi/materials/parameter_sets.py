"""Published parameter sets: one TOML file each in `sets/`, with unit, source and remark.

A file holds `title`, `source`, `remark`, `law`, the parameters of the law with their units and, where the source
names a value in words ("the initial bulk modulus is ..."), that claim as `stated_...`, to be held against the law.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from ngfsi import registry
from ngfsi.config.model import ConfigModel
from ngfsi.errors import MaterialError, unknown
from ngfsi.materials.law import Law
from ngfsi.materials.solid.law import SolidLaw
from ngfsi.units import Pressure, in_unit

SOLIDS, FLUIDS = "ngfsi.solid_laws", "ngfsi.fluid_laws"
"""Groups of the registry, in which laws have the names of their tag `law`."""
FOLDER = files("ngfsi.materials") / "sets"
STATED = "stated_"
MISMATCH = 0.01
"""Relative difference from which a stated modulus counts as another one."""


class Stated(ConfigModel):
    """Initial moduli (Pa) as the source states them in words; None where it does not."""

    shear_modulus: Pressure | None = None
    bulk_modulus: Pressure | None = None
    youngs_modulus: Pressure | None = None


@dataclass(frozen=True)
class ParameterSet:
    """A material with its provenance."""

    name: str
    title: str
    source: str
    remark: str
    material: Law
    stated: Stated

    @property
    def flags(self) -> tuple[str, ...]:
        """What is odd about it, a phrase each."""
        law = self.material
        if not isinstance(law, SolidLaw):
            return ()
        flags = ["negative Poisson ratio"] if (law.poissons_ratio or 0.0) < 0 else []
        for name in Stated.model_fields:
            stated, actual = getattr(self.stated, name), getattr(law, name)
            if stated is not None and abs(stated - actual) > MISMATCH * actual:
                words = name.replace("youngs", "Young's").replace("_", " ")
                numbers = (in_unit(modulus, "kPa", ".4g") for modulus in (stated, actual))
                flags.append("stated {0} {1} is not the initial {0} {2}".format(words, *numbers))
        return tuple(flags)


@cache
def available_sets() -> tuple[str, ...]:
    """Return the names of the parameter sets, sorted."""
    return tuple(sorted(file.name.removesuffix(".toml") for file in FOLDER.iterdir() if file.name.endswith(".toml")))


@cache
def read_set(name: str) -> ParameterSet:
    """Return a parameter set with its provenance.

    Raises:
        MaterialError: there is no such set, or its file is at fault.
    """
    if name not in available_sets():
        raise MaterialError(unknown("parameter set", name, available_sets()))
    file = FOLDER / f"{name}.toml"
    data = tomllib.loads(file.read_text(encoding="utf-8"))
    try:
        title, source, remark = (data.pop(key) for key in ("title", "source", "remark"))
        tag = data["law"]
    except KeyError as error:
        raise MaterialError(f"{file.name}: title, source, remark and law are needed, not found: {error}") from None
    law = registry.find(FLUIDS if tag in registry.names(FLUIDS) else SOLIDS, tag, "law", MaterialError)
    claims = {key: data.pop(key) for key in list(data) if key.startswith(STATED)}
    stated = Stated.from_dict({key.removeprefix(STATED): value for key, value in claims.items()}, source=file.name)
    material = law.from_dict({"label": name, **data}, source=file.name)
    return ParameterSet(name, title, source, " ".join(remark.split()), material, stated)


def load_set(name: str, **changes: Any) -> Law:
    """Return the material of a parameter set, with some values changed: `load_set("mooney_rivlin_s1", K_kPa=30)`.

    Raises:
        MaterialError: there is no such set, or a change is refused.
    """
    material = read_set(name).material
    return material.replace(**{"label": label_of(name, changes), **changes})


def label_of(name: str, changes: Mapping[str, Any]) -> str:
    """Return the label of a set with changed values, so that two variants are told apart in a figure."""
    listed = ", ".join(f"{key}={value}" for key, value in changes.items() if key != "label")
    return f"{name} ({listed})" if listed else name
