"""How the table of a case file becomes a material.

A material is written with a parameter set, `{set = "vein_wall"}`, a set with some values replaced,
`{set = "mooney_rivlin_s1", K_kPa = 30}`, or in full, `{law = "hencky", young_kPa = 133, ...}`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import PydanticCustomError, core_schema

from ngfsi.config.messages import key_error
from ngfsi.config.model import keys_of, registered
from ngfsi.errors import unknown
from ngfsi.materials.fluid.law import FluidLaw
from ngfsi.materials.law import Law
from ngfsi.materials.parameter_sets import FLUIDS, SOLIDS, available_sets, label_of, read_set
from ngfsi.materials.solid.law import SolidLaw


def _in_full(value: Any, base: type[Law]) -> Any:
    """Return the table with its set, if it names one, written out."""
    if isinstance(value, Mapping) and "set" in value:
        return _set_as_table(value["set"], {key: v for key, v in value.items() if key != "set"}, base)
    if not isinstance(value, base) and not (isinstance(value, Mapping) and "law" in value):
        text = f"a table with set = one of {', '.join(_sets(base))}, or with a law and its parameters"
        raise PydanticCustomError("table", "{text}", {"text": text})
    return value


def _set_as_table(name: Any, changes: dict[str, Any], base: type[Law]) -> dict[str, Any]:
    """Return a set as if it were written in full, its values replaced by those of `changes`, in whatever unit."""
    if not isinstance(name, str) or name not in _sets(base):
        kind = "parameter set for this region" if name in available_sets() else "parameter set"
        raise key_error("set", f"has an unknown value: {unknown(kind, str(name), _sets(base))}")
    given = read_set(name).material
    if changes.get("law", given.law) != given.law:
        raise key_error("law", f"contradicts the set: '{name}' is of law '{given.law}', leave one of the two out")
    keys = keys_of(type(given))
    changed = {keys[key].field for key in changes if key in keys}
    kept = {key: value for key, value in given.to_toml_dict().items() if keys[key].field not in changed}
    return {**kept, "label": label_of(name, changes), **changes}


def _sets(base: type[Law]) -> list[str]:
    return [name for name in available_sets() if isinstance(read_set(name).material, base)]


@dataclass(frozen=True)
class _SetOrLaw:
    """The annotation that reads a table with a set as if it were written in full.

    Attributes:
        base: of the laws.
    """

    base: type[Law]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_before_validator_function(
            lambda value: _in_full(value, self.base), handler(source)
        )  # fmt: skip

    def __get_pydantic_json_schema__(self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler) -> Any:
        by_set = {"type": "object", "properties": {"set": {"enum": _sets(self.base)}}, "required": ["set"]}
        return {"anyOf": [by_set, handler(schema)]}


SolidMaterial = Annotated[SolidLaw, registered("law", SOLIDS, SolidLaw), _SetOrLaw(SolidLaw)]
"""A solid in a case: a law, or a table with `set` or `law`."""

FluidMaterial = Annotated[FluidLaw, registered("law", FLUIDS, FluidLaw), _SetOrLaw(FluidLaw)]
"""A fluid in a case: a law, or a table with `set` or `law`."""
