"""The table of settings: `entry` enters what shows that keys have their effect."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from inspect import get_annotations
from typing import Any, get_args

from ngfsi import registry
from ngfsi.case import Case
from ngfsi.config.functions import (
    Curve,
    Hydrostatic,
    PressureConstant,
    PressureHarmonics,
    PressureRamp,
    PressureSmoothRamp,
    PressureTable,
    PressureWaveform,
)
from ngfsi.config.model import ConfigModel

GROUPS = (
    "ngfsi.geometries", "ngfsi.solid_laws", "ngfsi.fluid_laws", "ngfsi.openings", "ngfsi.conditions", "ngfsi.scalars"
)  # fmt: skip

CURVES = (PressureConstant, PressureRamp, PressureSmoothRamp, PressureTable, PressureHarmonics, PressureWaveform,
          Hydrostatic)  # fmt: skip

Outcome = tuple[Any, Any]
"""What a key does, and what it should do."""
ENTRIES: dict[str, tuple[Callable[[], Outcome], float]] = {}


def entry(*keys: str, rel: float = 1e-9) -> Callable[[Callable[[], Outcome]], Callable[[], Outcome]]:
    """Enter what shows that keys, `Class.key`, have their effect, to a relative tolerance."""

    def enter(shows: Callable[[], Outcome]) -> Callable[[], Outcome]:
        for key in keys:
            assert key not in ENTRIES, key
            ENTRIES[key] = shows, rel
        return shows

    return enter


def models_in(annotation: Any) -> Iterator[type[ConfigModel]]:
    """Yield the models that a field's type names."""
    if isinstance(annotation, type) and issubclass(annotation, ConfigModel):
        yield annotation
    for part in get_args(annotation):
        yield from models_in(part)


def _is_table_of_keys(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, ConfigModel) and not issubclass(annotation, Curve)


def all_keys() -> set[str]:
    """Return `Class.key` of every key that a case file may have, by the class that introduces it.

    A table of keys is none itself.
    """
    found: set[str] = set()
    done: set[type[ConfigModel]] = set()

    def walk(model: type[ConfigModel]) -> None:
        if model in done or model.__module__.startswith("tests."):
            return
        done.add(model)
        for name, field in model.model_fields.items():
            owner = next(base for base in reversed(model.__mro__) if name in get_annotations(base))
            if not _is_table_of_keys(field.annotation):
                found.add(f"{owner.__name__.split('[')[0]}.{name}")
            for inner in models_in(field.annotation):
                walk(inner)

    walk(Case)
    for curve in CURVES:
        walk(curve)
    for group in GROUPS:
        for model in registry.everything(group, "model").values():
            walk(model)
    return found
