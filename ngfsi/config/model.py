"""ConfigModel: a frozen, strictly checked part of a case, read from TOML tables whose keys carry the units.

A field `lumen_diameter: Length` is written `lumen_diameter_mm = 11.1` in a file and `lumen_diameter=0.0111` (SI) in
Python. Files are read with `ConfigModel.from_dict`, where a quantity without a unit is an error; the constructor takes
plain SI names (and also the names with a unit). Lists become tuples, a table with a tag (`kind`, `law`) becomes the
class of that tag. Types are strict: no text for numbers, no booleans for numbers, nothing infinite.

Every refusal is one sentence in terms of what the user wrote (see `messages.py`): a `CaseError`, or the class named
by the section's `refusal`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from types import UnionType
from typing import Annotated, Any, ClassVar, NamedTuple, Self, Union, get_args, get_origin

from pydantic import (
    BaseModel,
    ConfigDict,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic_core import PydanticCustomError, core_schema

from ngfsi import registry
from ngfsi.config.messages import key_error, validation_message
from ngfsi.errors import CaseError, NgfsiError, suggestion, unknown
from ngfsi.units import SI_SUFFIX, UNITS, Dimension, suffixes, to_si

FROM_FILE = {"units_required": True}
"""Validation context of data read from a file: quantities must carry their unit."""


class Key(NamedTuple):
    """What a written key stands for: the field, and the unit of its numbers (None: a plain or SI name)."""

    field: str
    unit: str | None


class ConfigModel(BaseModel):
    """Base of all parts of a case."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    refusal: ClassVar[type[NgfsiError]] = CaseError
    """The class of error raised for values this section refuses."""
    instead_of_file: ClassVar[tuple[str, ...]] = ()
    """Fields in place of which a table may name a `file` that holds them."""

    def __init__(self, /, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            source = type(self).__name__.partition("[")[0]
            raise self.refusal(validation_message(error, values, source=source)) from None

    # Tells pydantic that nested sections need not be built through this __init__, which only words errors
    # (pydantic's own RootModel does the same): their errors then carry the whole key path.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    def __eq__(self, other: object) -> bool:
        """Compare types and values; pydantic's own compares what properties have cached, too."""
        if type(self) is not type(other):
            return NotImplemented
        return all(getattr(self, name) == getattr(other, name) for name in type(self).model_fields)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], source: str = "") -> Self:
        """Return the section written in `data`, e.g. a parsed TOML file; `source` names the file in errors."""
        try:
            return cls.model_validate(dict(data), context=FROM_FILE)
        except ValidationError as error:
            raise cls.refusal(validation_message(error, data, source=source)) from None

    def to_toml_dict(self) -> dict[str, Any]:
        """Return plain tables, lists and scalars with SI keys, from which `from_dict` gives an equal section."""
        written = {}
        for name in type(self).model_fields:
            value = getattr(self, name)
            if value is not None:
                written[si_key(type(self), name)] = _plain(value)
        return written

    def replace(self, /, **changes: Any) -> Self:
        """Return a copy with some values changed, checked anew.

        Args:
            changes: dotted key path -> value, e.g. `replace(**{"time.step": 0.05, "materials.tissue": law})`; numbers
                are SI unless the key carries a unit (`time.step_ms`). Values that depend on a default are renewed.

        Raises:
            CaseError: a key is unknown or a value is refused (or the error class of the section concerned).
        """
        return self._changed(changes, "")

    def _changed(self, changes: Mapping[str, Any], prefix: str) -> Self:
        values = {name: getattr(self, name) for name in type(self).model_fields if name in self.model_fields_set}
        inside: dict[str, dict[str, Any]] = {}
        for written, value in changes.items():
            key, _, rest = written.partition(".")
            if rest:
                inside.setdefault(key, {})[rest] = value
            else:
                known = keys_of(type(self)).get(key)
                values.pop(known.field if known else key, None)
                values[key] = value
        for key, part in inside.items():
            path = f"{prefix}.{key}" if prefix else key
            if key in changes:
                raise CaseError(f"'{path}' cannot be changed together with keys inside it")
            known = keys_of(type(self)).get(key)
            current = getattr(self, known.field) if known else None
            if not isinstance(current, ConfigModel):
                raise CaseError(f"'{path}' {'holds no keys' if known else _unknown_key(type(self), key)}")
            values[key] = current._changed(part, path)
        try:
            return type(self).model_validate(values)
        except ValidationError as error:
            raise self.refusal(validation_message(error, values, prefix=prefix)) from None

    @model_validator(mode="before")
    @classmethod
    def _read_keys(cls, data: Any, info: ValidationInfo) -> Any:
        """Turn written keys into fields in SI units; pass anything but a table on."""
        if not isinstance(data, Mapping):
            return data
        units_required = bool(info.context and info.context.get("units_required"))
        fields: dict[str, Any] = {}
        origin: dict[str, str] = {}
        for written, value in data.items():
            key = keys_of(cls).get(written)
            if key is None or (units_required and key.unit is None and dimension_of_field(cls, key.field)):
                raise key_error(written, _unknown_key(cls, written))
            if key.field in origin:
                raise key_error(
                    written, f"is given twice: '{origin[key.field]}' is the same quantity, keep one of them"
                )
            origin[key.field] = written
            fields[key.field] = _converted(value, key.unit)
        for name, field in cls.model_fields.items():
            if field.is_required() and name not in fields:
                raise key_error(_spellings(cls, name)[0], f"is missing: {_purpose(cls, name)}")
        return fields


@cache
def keys_of(cls: type[ConfigModel]) -> dict[str, Key]:
    """Return every key that may be written for a section, and what it stands for."""
    keys: dict[str, Key] = {}
    for name in cls.model_fields:
        keys[name] = Key(name, None)
        dimension = dimension_of_field(cls, name)
        for suffix in suffixes(dimension) if dimension else []:
            keys[f"{name}_{suffix}"] = Key(name, suffix)
    return keys


def dimension_of_field(cls: type[ConfigModel], name: str) -> str | None:
    """Return the physical dimension of a field's numbers, or None where they have none."""
    field = cls.model_fields[name]
    return _dimension(field.annotation, field.metadata)


def si_key(cls: type[ConfigModel], name: str) -> str:
    """Return the key of a field in SI, e.g. `lumen_diameter_m`."""
    dimension = dimension_of_field(cls, name)
    return f"{name}_{SI_SUFFIX[dimension]}" if dimension else name


@dataclass(frozen=True)
class Tagged:
    """The annotation that reads a table as the model of its tag, of those that `models` returns by name.

    Attributes:
        tag: key whose value is the name.
        accepted: instances of which are taken as they are.
        names: returns the names.
        find: returns the model of a name, or raises NgfsiError.
    """

    tag: str
    accepted: type[ConfigModel] | tuple[type[ConfigModel], ...]
    names: Callable[[], Iterable[str]]
    find: Callable[[str], type[ConfigModel]]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.with_info_before_validator_function(self._choose, handler(source))

    def __get_pydantic_json_schema__(self, _: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return one_of(self.tag, {name: self.find(name) for name in self.names()}, handler)

    def _choose(self, value: Any, info: ValidationInfo) -> Any:
        if isinstance(value, self.accepted):
            return value
        if not isinstance(value, Mapping) or self.tag not in value:
            listed = ", ".join(f"'{name}'" for name in self.names()) or "those that a plugin registers"
            if isinstance(value, Mapping):
                raise key_error(self.tag, f"is missing: write one of {listed}")
            raise PydanticCustomError("table", "{text}", {"text": f"a table with {self.tag} = one of {listed}"})
        try:
            model = self.find(str(value[self.tag]))
        except NgfsiError as error:
            raise key_error(self.tag, f"has an unknown value: {error}") from None
        return model.model_validate(value, context=info.context)


def one_of(tag: str, models: Mapping[str, type[ConfigModel]], handler: GetJsonSchemaHandler) -> dict[str, Any]:
    """Return the JSON schema of a table that is one of several models, by the name that stands under its tag."""
    found = []
    for name, model in models.items():
        schema = handler.resolve_ref_schema(handler(model.__pydantic_core_schema__))
        others = {key: value for key, value in schema.get("properties", {}).items() if key != tag}
        found.append(
            schema | {"properties": {tag: {"const": name}, **others}, "required": [tag, *schema.get("required", ())]}
        )
    return {"oneOf": found}


def tagged(tag: str, *classes: type[ConfigModel]) -> Tagged:
    """Return the annotation that reads a table as the one of `classes` whose tag it carries."""
    by_tag = {cls.model_fields[tag].default: cls for cls in classes}

    def find(name: str) -> type[ConfigModel]:
        if name not in by_tag:
            raise CaseError(unknown(tag, name, by_tag))
        return by_tag[name]

    return Tagged(tag, classes, lambda: by_tag, find)


def registered(tag: str, group: str, base: type[ConfigModel]) -> Tagged:
    """Return the annotation that reads a table as the `base` that the registry's group knows by the tag's value."""
    return Tagged(tag, base, lambda: registry.names(group), lambda name: registry.find(group, name, tag))


def _dimension(annotation: Any, metadata: list[Any] | tuple[Any, ...] = ()) -> str | None:
    """Find the Dimension in an annotation: directly, in a list or an optional (sections have their own)."""
    for item in metadata:
        if isinstance(item, Dimension):
            return item.name
    origin = get_origin(annotation)
    if origin is Annotated:
        inner, *rest = get_args(annotation)
        return _dimension(inner, rest)
    inside = get_args(annotation) if origin in (tuple, Union, UnionType) else ()
    return next((found for found in map(_dimension, inside) if found), None)


def _converted(value: Any, unit: str | None) -> Any:
    """Convert the numbers in a written value to SI and its lists to tuples; leave the rest for the type check."""
    if isinstance(value, (list, tuple)):
        return tuple(_converted(item, unit) for item in value)
    if unit is not None and isinstance(value, (int, float)) and not isinstance(value, bool):
        return to_si(value, unit)
    return value


def _plain(value: Any) -> Any:
    if isinstance(value, ConfigModel):
        return value.to_toml_dict()
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def _unknown_key(cls: type[ConfigModel], written: str) -> str:
    """Return why a key is refused: unit missing, unit of another dimension, or unknown with the nearest known ones."""
    for name in cls.model_fields:
        head, _, unit = written.partition(f"{name}_")
        if dimension_of_field(cls, name) and written == name:
            return f"needs its unit in the key: write {_one_of(cls, name)}"
        if dimension_of_field(cls, name) and not head and unit in UNITS:
            return f"has a unit of {UNITS[unit].dimension.replace('_', ' ')}: write {_one_of(cls, name)}"
    spellings = [spelling for name in cls.model_fields for spelling in _spellings(cls, name)]
    accepted = ", ".join(_spellings(cls, name)[0] for name in cls.model_fields)
    return f"is not a known key: {suggestion(written, spellings)}accepted here are {accepted}"


def _spellings(cls: type[ConfigModel], name: str) -> list[str]:
    """Return how a field may be written in a file, the SI key first."""
    dimension = dimension_of_field(cls, name)
    return [f"{name}_{suffix}" for suffix in suffixes(dimension)] if dimension else [name]


def _purpose(cls: type[ConfigModel], name: str) -> str:
    return f"write {_one_of(cls, name)}" if dimension_of_field(cls, name) else f"a {cls.__name__} needs it"


def _one_of(cls: type[ConfigModel], name: str) -> str:
    return " or ".join(f"'{spelling}'" for spelling in _spellings(cls, name))
