"""The reference of case files in Markdown (MyST), from their JSON schema: every key, its units, default and range."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

from ngfsi.units import UNITS, readable, suffixes, to_si, unit_of

NUMBERED = re.compile(r"_\d+$")
"""Parts that differ from one of the same name by the units of their quantity alone."""
PLAIN = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true or false", "object": "table"}
TAGS = ("type", "law", "kind")
HEAD = "| key | value | default | meaning |\n|---|---|---|---|"


def reference(schema: dict[str, Any]) -> str:
    """Return the text of a JSON schema (see `json_schema`): a heading and a table for each part, with links."""
    parts = {"Case": schema, **{name: part for name, part in schema["$defs"].items() if not NUMBERED.search(name)}}
    tags = ["", *TAGS]
    ordered = sorted(parts, key=lambda name: tags.index(_tag(parts[name])[0]))
    return "\n\n".join(_part(name, parts) for name in ordered)


def _tag(part: dict[str, Any]) -> tuple[str, str]:
    """Return the key and the value that tell a table from others in its place, or two empty texts."""
    found = ((key, value["const"]) for key, value in part["properties"].items() if "const" in value)
    return next(found, ("", ""))


def _part(name: str, parts: dict[str, Any]) -> str:
    part = parts[name]
    key, value = _tag(part)
    title = f'{key} = "{value}"' if key else name
    rows = "\n".join(_rows(part, parts))
    return f"(case-{name})=\n## {title}\n\n{part.get('description', '')}\n\n{HEAD}\n{rows}"


def _rows(part: dict[str, Any], parts: dict[str, Any]) -> Iterator[str]:
    properties = part["properties"]
    needed = {
        *part.get("required", ()),
        *(one["required"][0] for all_of in part.get("allOf", ()) for one in all_of["anyOf"]),
    }
    keys = iter(properties)
    for key in keys:
        if "const" in properties[key]:
            continue
        spelled, written = f"`{key}`", key
        if family := _family(key, properties):
            unit = _usual(key, properties[key])
            written = f"{key.removesuffix(unit_of(key))}{unit}"
            spelled = ", ".join([f"`{written}`", *(f"`_{other}`" for other in family if other != unit)])
            for _ in family[1:]:
                next(keys)
        value = properties[written]
        default = "needed" if key in needed else _default(value.get("default"))
        said = value.get("description") or parts.get(_linked(value), {}).get("description", "").partition("\n\n")[0]
        cells = (
            spelled,
            f"{_words(value, parts)}{_limits(value)}",
            default,
            " ".join(said.split()).replace("|", "\\|"),
        )
        yield f"| {' | '.join(cells)} |"


def _default(value: Any) -> str:
    if value in (None, [], ""):
        return ""
    return "see there" if isinstance(value, dict) else f"`{_toml(value)}`"


def _family(key: str, properties: dict[str, Any]) -> list[str]:
    """Return the units in which a quantity may be given, the first one that of the key."""
    unit = unit_of(key)
    if unit not in UNITS:
        return []
    name, units = key.removesuffix(f"_{unit}"), suffixes(UNITS[unit].dimension)
    return units if all(f"{name}_{one}" in properties for one in units) else []


def _usual(key: str, value: dict[str, Any]) -> str:
    default, unit = value.get("default"), unit_of(key)
    numbers = default if isinstance(default, list) else [default] if isinstance(default, int | float) else []
    return readable(UNITS[unit].dimension, [to_si(number, unit) for number in numbers])


def _linked(value: dict[str, Any]) -> str:
    """Return the name of the part that a value refers to, if it does."""
    return NUMBERED.sub("", value.get("$ref", "").rpartition("/")[2])


def _words(value: dict[str, Any], parts: dict[str, Any]) -> str:
    """Return what a value is, in words or as links to tables."""
    if name := _linked(value):
        return f"[{_tag(parts[name])[1] or name}](#case-{name})"
    for several in ("oneOf", "anyOf"):
        if several in value:
            return " or ".join(dict.fromkeys(_words(one, parts) for one in value[several] if one.get("type") != "null"))
    if "enum" in value:
        return ", ".join(f"`{_toml(one)}`" for one in value["enum"])
    if value.get("type") == "array":
        return f"list of: {_words(value['items'], parts)}" if "items" in value else "list"
    if isinstance(value.get("additionalProperties"), dict):
        return f"table of: {_words(value['additionalProperties'], parts)}"
    if "set" in value.get("properties", {}):
        return "`set` with changes"
    return PLAIN.get(str(value.get("type")), "")


def _limits(value: dict[str, Any]) -> str:
    """Return the range of a number, e.g. ", > 0, at most 5"."""
    for one in (value, *value.get("anyOf", ())):
        words = {
            "exclusiveMinimum": "> {}",
            "minimum": "at least {}",
            "exclusiveMaximum": "< {}",
            "maximum": "at most {}",
        }
        if found := [text.format(f"{one[key]:g}") for key, text in words.items() if key in one]:
            return f", {', '.join(found)}"
    return ""


def _toml(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)
