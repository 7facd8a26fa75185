"""What may be written in a case file: its JSON schema, and the meaning of each key, made from the models themselves."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator
from functools import cache
from itertools import count, pairwise
from typing import Any

from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import core_schema

from ngfsi.config.model import ConfigModel, dimension_of_field
from ngfsi.units import from_si, suffixes

LIMITS = ("minimum", "exclusiveMinimum", "maximum", "exclusiveMaximum", "default")
DIALECT = "http://json-schema.org/draft-07/schema#"
"""What editors of TOML (Taplo, Even Better TOML) understand."""
DIGITS = 12


class CaseSchema(GenerateJsonSchema):
    """JSON schema of a section: a quantity has one key for each unit that it may be given in."""

    def model_schema(self, schema: core_schema.ModelSchema) -> dict[str, Any]:
        """Return the schema of a model in which quantities carry their units."""
        written = super().model_schema(schema)
        cls = schema["cls"]
        if not issubclass(cls, ConfigModel):
            return written
        written["title"] = cls.__name__
        written["description"] = inspect.getdoc(cls.__pydantic_generic_metadata__["origin"] or cls)
        properties: dict[str, Any] = {}
        needed = set(written.pop("required", []))
        choices = []
        for name, value in written.get("properties", {}).items():
            value.pop("title", None)
            if said := meaning(cls, name):
                value["description"] = said
            dimension = dimension_of_field(cls, name)
            units = suffixes(dimension) if dimension else []
            keys = {f"{name}_{unit}": _in_unit(value, unit) for unit in units} or {name: value}
            properties |= keys
            if name in needed:
                choices.append([*keys, *(["file"] if name in cls.instead_of_file else [])])
        if cls.instead_of_file:
            properties["file"] = {"type": "string", "description": f"CSV with {', '.join(cls.instead_of_file)}"}
        if properties:
            written["properties"] = properties
        if single := [key for (key, *others) in choices if not others]:
            written["required"] = single
        if several := [{"anyOf": [{"required": [key]} for key in keys]} for keys in choices if len(keys) > 1]:
            written["allOf"] = several
        return written

    def encode_default(self, dft: Any) -> Any:
        """Return a default as it would be written in a file."""
        return dft.to_toml_dict() if isinstance(dft, ConfigModel) else super().encode_default(dft)


def json_schema(model: type[ConfigModel]) -> dict[str, Any]:
    """Return the JSON schema of the file of a model, with what is registered when it is asked for."""
    written = model.model_json_schema(schema_generator=CaseSchema)
    parts: dict[str, Any] = {}
    for name, part in written.pop("$defs", {}).items():
        parts[name] = _inside(part, parts)
    whole = {key: _shared(value, parts) for key, value in written.items()}
    return {"$schema": DIALECT, **whole, "$defs": parts}


def _shared(value: Any, parts: dict[str, Any]) -> Any:
    """Return a schema in which tables that have a title are references to `parts`, to which they are added."""
    value = _inside(value, parts)
    if not isinstance(value, dict) or not isinstance(value.get("title"), str) or "properties" not in value:
        return value
    name = next(name for name in _names(value["title"]) if parts.get(name, value) == value)
    parts[name] = value
    return {"$ref": f"#/$defs/{name}"}


def _inside(value: Any, parts: dict[str, Any]) -> Any:
    if isinstance(value, dict):
        return {key: _shared(one, parts) for key, one in value.items()}
    return [_shared(one, parts) for one in value] if isinstance(value, list) else value


def _names(title: str) -> Iterator[str]:
    """Return names for parts of this title, of which several may differ, as those of a quantity in other units."""
    plain = title.partition("[")[0]
    return (plain if number == 1 else f"{plain}_{number}" for number in count(1))


@cache
def meaning(cls: type[ConfigModel], name: str) -> str:
    """Return what a field means: its `description`, the text below it in its class, or what stands under the
    `Attributes` of that; empty if there is none."""
    field = cls.model_fields[name]
    if field.description:
        return field.description
    return next((texts[name] for texts in map(_texts, cls.__mro__) if name in texts), "")


@cache
def _texts(cls: type) -> dict[str, str]:
    """Return the texts below the fields of a class, by name, of the class itself alone."""
    if not issubclass(cls, ConfigModel):
        return {}
    origin = cls.__pydantic_generic_metadata__["origin"] or cls
    try:
        body = ast.parse(textwrap.dedent(inspect.getsource(origin))).body[0]
    except (OSError, SyntaxError):
        return {}
    if not isinstance(body, ast.ClassDef):
        return {}
    listed = inspect.cleandoc(origin.__doc__ or "").partition("Attributes:\n")[2]
    found: dict[str, str] = {}
    for names, text in re.findall(r"^    (\w+(?:, \w+)*): (.+(?:\n     .+)*)", listed, re.MULTILINE):
        found |= dict.fromkeys(names.split(", "), " ".join(text.split()))
    return found | dict(_pairs(body.body))


def _pairs(body: list[ast.stmt]) -> Iterator[tuple[str, str]]:
    for field, text in pairwise(body):
        match field, text:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(said))):
                yield name, " ".join(inspect.cleandoc(said).split())


def _in_unit(value: Any, unit: str) -> Any:
    """Return a schema whose limits and defaults are in a unit."""
    if isinstance(value, dict):
        return {key: _scaled(one, unit) if key in LIMITS else _in_unit(one, unit) for key, one in value.items()}
    return [_in_unit(one, unit) for one in value] if isinstance(value, list) else value


def _scaled(value: Any, unit: str) -> Any:
    if isinstance(value, list):
        return [_scaled(one, unit) for one in value]
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    return float(f"{from_si(value, unit):.{DIGITS}g}")
