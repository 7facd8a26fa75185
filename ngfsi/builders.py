"""Find a geometry builder by its import path, e.g. `geometry.calf:CalfSegment`.

The builders stand beside the engine, in the package `geometry` of a clone, and are not part of an installed wheel.
A builder is a Section with a method `netgen_mesh`.
"""

from __future__ import annotations

import re
from importlib import import_module
from importlib.util import find_spec
from inspect import isabstract
from pkgutil import iter_modules
from typing import TypeGuard

from ngfsi.errors import GeometryError, unknown
from ngfsi.section import Section

PACKAGE = "geometry"
PATTERN = re.compile(rf"{PACKAGE}(\.[A-Za-z_]\w*)+:[A-Za-z_]\w*")


def find_builder(path: str) -> type[Section]:
    """Return the builder class at an import path.

    Raises:
        GeometryError: the path is malformed or no builder is there.
    """
    if find_spec(PACKAGE) is None:
        raise GeometryError("the geometry builders are not installed: they come with a clone of the project")
    module, _, name = path.partition(":")
    if not PATTERN.fullmatch(path) or not _exists(module):
        raise GeometryError(unknown("geometry", path, available_builders()))
    builder = getattr(import_module(module), name, None)
    if not _is_builder(builder):
        raise GeometryError(unknown("geometry", path, available_builders()))
    return builder


def path_of(builder: type[Section]) -> str:
    """Return the import path under which `find_builder` finds the class."""
    return f"{builder.__module__}:{builder.__qualname__}"


def available_builders() -> list[str]:
    """Return the import paths of all builders."""
    package = import_module(PACKAGE)
    modules = [import_module(f"{PACKAGE}.{info.name}") for info in iter_modules(package.__path__)]
    return [
        f"{module.__name__}:{name}"
        for module in modules
        for name, item in vars(module).items()
        if _is_builder(item) and item.__module__ == module.__name__
    ]


def _exists(module: str) -> bool:
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:  # a parent in the dotted path is missing
        return False


def _is_builder(item: object) -> TypeGuard[type[Section]]:
    return (
        isinstance(item, type) and issubclass(item, Section) and hasattr(item, "netgen_mesh") and not isabstract(item)
    )
