"""Turn a pydantic ValidationError into one sentence in the terms of what the user wrote.

Pydantic knows the fields (`c10`, in SI); the user wrote keys (`c10_kPa`). The written data is walked along the
error's location to recover the key, its unit and the value as given.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from ngfsi.errors import suggestion
from ngfsi.units import UNITS, from_si

WANTED = {
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "string_type": "text in quotes",
    "bool_type": "true or false",
    "tuple_type": "a list in brackets",
    "model_type": "a table of keys",
}
LIMITS = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "of at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "of at most"),
}
LENGTHS = {"too_short": ("min_length", "of at least"), "too_long": ("max_length", "of at most")}


class Place(NamedTuple):
    """Where the error is: the dotted path as written, the value there and the unit of the last key."""

    path: str
    value: Any
    unit: str | None


def key_error(key: str, text: str) -> PydanticCustomError:
    """Return the error of a key in a table; `text` continues the sentence that begins with the key's path."""
    return PydanticCustomError("key", "{text}", {"key": key, "text": text})


def validation_message(error: ValidationError, data: Any, *, source: str = "", prefix: str = "") -> str:
    """Return the sentence for the first thing wrong in `data`, whose own key path is `prefix`."""
    # a default computed from another field is reported as well when that field is wrong: not the user's business
    errors = [e for e in error.errors(include_url=False) if e["type"] != "default_factory_not_called"]
    first = errors[0]
    sentence = _sentence(first, _locate(first["loc"], data, first["input"]), prefix)
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    return (f"{source}: " if source else "") + sentence + more


def _locate(location: Sequence[int | str], data: Any, value: Any) -> Place:
    """Walk the written data along pydantic's location; what is not written there keeps its field name."""
    path: list[str] = []
    unit = None
    for part in location:
        if isinstance(part, int):
            path[-1] += f"[{part}]"
            data = data[part] if isinstance(data, Sequence) and part < len(data) else None
        elif isinstance(data, Mapping):
            key, unit = _written(data, part)
            path.append(key)
            data = data.get(key)
        elif data is None:
            path.append(part)
    return Place(".".join(path), value if data is None else data, unit)


def _written(table: Mapping[str, Any], field: str) -> tuple[str, str | None]:
    """Return the key under which a field was written and its unit."""
    for key in table:
        head, _, unit = key.partition(f"{field}_")
        if not head and unit in UNITS:
            return key, unit
    return field, None


def _sentence(error: ErrorDetails, place: Place, prefix: str) -> str:
    context = error.get("ctx", {})
    if error["type"] == "key":
        path = ".".join(filter(None, (prefix, place.path, context["key"])))
        return f"'{path}' {context['text']}"
    path = ".".join(filter(None, (prefix, place.path)))
    if error["type"] == "missing":  # ConfigModel itself reports missing fields: this is an entry of a list
        return f"{path} is missing: the list is too short"
    if error["type"] == "value_error":
        return f"{path}: {context['error']}" if path else str(context["error"])
    return f"{path or 'the input'} = {_shown(place.value)} is not accepted: {_wanted(error, place)} is wanted"


def _wanted(error: ErrorDetails, place: Place) -> str:
    kind, context = error["type"], error.get("ctx", {})
    if kind in WANTED:
        return WANTED[kind]
    if kind in LIMITS:
        name, words = LIMITS[kind]
        limit = from_si(context[name], place.unit) if place.unit else context[name]
        return f"a number {words} {limit:.6g}"
    if kind in LENGTHS:
        name, words = LENGTHS[kind]
        return f"a list {words} {context[name]}"
    if kind == "literal_error":
        names = str(context["expected"]).replace(" or ", ", ")
        near = suggestion(str(place.value), re.findall("'([^']*)'", names))
        return f"{near}one of {names}"
    return str(context.get("text") or error["msg"])


def _shown(value: Any) -> str:
    """Return a value much as it stands in a TOML file, shortened."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, BaseModel):
        return f"a {type(value).__name__.partition('[')[0]}"
    if isinstance(value, Mapping):
        return "{ " + ", ".join(value) + " }" if value else "{}"
    text = f"'{value}'" if isinstance(value, str) else str(list(value) if isinstance(value, tuple) else value)
    return text if len(text) <= 60 else text[:57] + "..."
