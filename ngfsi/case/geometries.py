"""Find a geometry builder by its import path, e.g. `ngfsi_geometry.calf:CalfSegment`.

The builders stand beside the engine, in the package `geometry` of a clone, and are not part of an installed wheel.
A builder is a ConfigModel with a method `netgen_mesh`. Importing a module executes it, and case files come from
anywhere: other packages are imported only if the user names them in the environment variable NGFSI_GEOMETRY.
"""

from __future__ import annotations

import os
import re
from importlib import import_module
from importlib.util import find_spec
from inspect import isabstract
from pathlib import Path
from pkgutil import iter_modules
from typing import TypeGuard

from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError, unknown

PACKAGE = "ngfsi_geometry"
OPT_IN = "NGFSI_GEOMETRY"
"""Environment variable with the names of further packages, separated by commas."""
PATTERN = re.compile(r"([A-Za-z_]\w*)(\.[A-Za-z_]\w*)+:[A-Za-z_]\w*")


def find_builder(path: str) -> type[ConfigModel]:
    """Return the builder class at an import path.

    Raises:
        GeometryError: the path is malformed or no builder is there.
    """
    module, _, name = path.partition(":")
    matched = PATTERN.fullmatch(path)
    if matched:
        _refuse_strangers(matched[1], path)
    if not matched or not _exists(module):
        raise GeometryError(unknown("geometry", path, available_builders()))
    builder = getattr(import_module(module), name, None)
    if not _is_builder(builder):
        raise GeometryError(unknown("geometry", path, available_builders()))
    return builder


def _refuse_strangers(package: str, path: str) -> None:
    """Refuse packages that may not be imported, before anything of them is."""
    if package in os.environ.get(OPT_IN, "").replace(" ", "").split(","):
        return
    if package != PACKAGE:
        raise GeometryError(
            f"'{path}' lies outside of the package {PACKAGE}: set {OPT_IN}={package} if you trust its code"
        )
    spec = find_spec(PACKAGE)
    if spec is None:
        raise GeometryError("the geometry builders are not installed: they come with a clone of the project")
    if not spec.origin or Path(spec.origin).resolve().parents[2] != Path(__file__).resolve().parents[2]:
        raise GeometryError(
            f"the package {PACKAGE} in '{spec.origin}' is not the one of this clone: if you trust it "
            f"set {OPT_IN}={PACKAGE}"
        )


def path_of(builder: type[ConfigModel]) -> str:
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


def _is_builder(item: object) -> TypeGuard[type[ConfigModel]]:
    return (
        isinstance(item, type)
        and issubclass(item, ConfigModel)
        and hasattr(item, "netgen_mesh")
        and not isabstract(item)
    )
