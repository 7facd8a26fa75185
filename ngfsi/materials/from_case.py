"""How the table of a case file becomes a material.

A material is written with a parameter set, `{set = "vein_wall"}`, a set with some values replaced,
`{set = "mooney_rivlin_s1", K_kPa = 30}`, or in full, `{law = "hencky", young_kPa = 133, ...}`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, ValidationInfo
from pydantic_core import PydanticCustomError

from ngfsi.config.messages import key_error
from ngfsi.config.model import choose_tagged, keys_of
from ngfsi.errors import unknown
from ngfsi.materials.fluid.law import FluidLaw
from ngfsi.materials.law import Law
from ngfsi.materials.parameter_sets import available_sets, label_of, read_set
from ngfsi.materials.registry import FLUID_LAWS, SOLID_LAWS
from ngfsi.materials.solid.law import SolidLaw


def _solid(value: Any, info: ValidationInfo) -> Any:
    return _material(value, info, SOLID_LAWS)


def _fluid(value: Any, info: ValidationInfo) -> Any:
    return _material(value, info, FLUID_LAWS)


SolidMaterial = Annotated[SolidLaw, BeforeValidator(_solid)]
"""A solid in a case: a law, or a table with `set` or `law`."""

FluidMaterial = Annotated[FluidLaw, BeforeValidator(_fluid)]
"""A fluid in a case: a law, or a table with `set` or `law`."""


def _material(value: Any, info: ValidationInfo, classes: tuple[type[Law], ...]) -> Any:
    """Return the law that the table describes, one of `classes`."""
    if isinstance(value, Mapping) and "set" in value:
        value = _set_as_table(value["set"], {key: v for key, v in value.items() if key != "set"}, classes)
    elif not isinstance(value, (Mapping, *classes)) or (isinstance(value, Mapping) and "law" not in value):
        text = f"a table with set = one of {', '.join(_sets(classes))}, or with a law and its parameters"
        raise PydanticCustomError("table", "{text}", {"text": text})
    return choose_tagged(value, info, "law", classes)


def _set_as_table(name: Any, changes: dict[str, Any], classes: tuple[type[Law], ...]) -> dict[str, Any]:
    """Return a set as if it were written in full, its values replaced by those of `changes`, in whatever unit."""
    if not isinstance(name, str) or name not in _sets(classes):
        kind = "parameter set for this region" if name in available_sets() else "parameter set"
        raise key_error("set", f"has an unknown value: {unknown(kind, str(name), _sets(classes))}")
    base = read_set(name).material
    if changes.get("law", base.law) != base.law:
        raise key_error("law", f"contradicts the set: '{name}' is of law '{base.law}', leave one of the two out")
    keys = keys_of(type(base))
    changed = {keys[key].field for key in changes if key in keys}
    kept = {key: value for key, value in base.to_toml_dict().items() if keys[key].field not in changed}
    return {**kept, "label": label_of(name, changes), **changes}


def _sets(classes: tuple[type[Law], ...]) -> list[str]:
    return [name for name in available_sets() if isinstance(read_set(name).material, classes)]
