"""What a case file may hold, and what it means where it says nothing: every key with its default and its limits.

Case files of users rest on it, so that it is written down in `contract.txt`; who changes it on purpose runs

    python -m tests.settings.contract

and tells users in CHANGELOG.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from ngfsi import registry
from ngfsi.case import Case
from ngfsi.config.model import ConfigModel
from ngfsi.units import Dimension
from tests.settings.table import CURVES, GROUPS, models_in

FILE = Path(__file__).with_name("contract.txt")


def lines() -> list[str]:
    """Return a line for each key: `Class.key = default; limits`, in SI."""
    found, done = set(), set()

    def walk(model: type[ConfigModel]) -> None:
        if model in done or model.__module__.startswith("tests."):
            return
        done.add(model)
        for name, field in model.model_fields.items():
            limits = ", ".join([*_choices(field.annotation), *_limits(field.metadata)])
            default = _default(field)
            found.add(f"{model.__name__.split('[')[0]}.{name} = {default}" + (f"; {limits}" if limits else ""))
            for inner in models_in(field.annotation):
                walk(inner)

    for model in (Case, *CURVES):
        walk(model)
    for group in GROUPS:
        for model in registry.everything(group, "model").values():
            walk(model)
    return sorted(found)


def _default(field: FieldInfo) -> str:
    if field.default_factory is not None:
        made = field.default_factory
        return f"a new {made.__name__}" if isinstance(made, type) else "from other keys"
    return "required" if field.default is PydanticUndefined else repr(field.default)


def _choices(annotation: Any) -> Iterator[str]:
    if get_origin(annotation) is Literal:
        yield " | ".join(map(str, get_args(annotation)))


def _limits(metadata: list[Any]) -> Iterator[str]:
    for one in metadata:
        if isinstance(one, Dimension):
            yield one.name
        elif (text := repr(one)).isprintable() and " at 0x" not in text:
            yield text


if __name__ == "__main__":
    FILE.write_text("\n".join(lines()) + "\n", encoding="utf-8")
