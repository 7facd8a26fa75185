"""Names under which geometries, laws, conditions, quantities, studies and benchmarks are known.

A package registers what it has by Python entry points in groups such as `ngfsi.geometries`; that is how ngfsi's own are
known, too. Nothing is imported before it is asked for. A user's own Python file registers its classes itself,

    @register("ngfsi.geometries", "my_vein")
    class MyVein(TubeSegment): ...

and is loaded where the command line names it (`--plugin my_vein.py`), and never because a case file does. Child
processes and other ranks `load` the `plugins` of the process that started them.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from functools import cache
from hashlib import sha256
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any, TypeVar

from ngfsi.errors import NgfsiError, unknown

T = TypeVar("T", bound=type)

IN_CASES = (
    "ngfsi.geometries", "ngfsi.solid_laws", "ngfsi.fluid_laws", "ngfsi.conditions", "ngfsi.openings", "ngfsi.scalars"
)  # fmt: skip
"""Groups of what case files name."""

_registered: list[EntryPoint] = []
_files: dict[Path, str] = {}
"""Plugins and the SHA-256 of their content."""


@cache
def installed(group: str) -> EntryPoints:
    """Return the entry points of a group of installed packages."""
    return entry_points(group=group)


def names(group: str) -> list[str]:
    """Return the names of a group, sorted."""
    return sorted({entry.name for entry in _entries(group)})


def find(group: str, name: str, what: str, error: type[NgfsiError] = NgfsiError) -> Any:
    """Return what is registered under a name.

    Args:
        what: the kind of thing, for the sentence.
        error: raised if the name is unknown, or stands for several things, or what it stands for cannot be loaded.
    """
    found = [entry for entry in _entries(group) if entry.name == name]
    if not found:
        hint = ", and what a Python file registers that --plugin names" if group in IN_CASES else ""
        raise error(unknown(what, name, names(group)) + hint)
    if len(found) > 1:
        raise error(f"several things are registered as the {what} '{name}': {', '.join(map(_origin, found))}")
    try:
        return found[0].load()
    except Exception as failure:
        raise error(
            f"the {what} '{name}' cannot be loaded from {_origin(found[0])}: {type(failure).__name__}: {failure}"
        ) from failure


def everything(group: str, what: str) -> dict[str, Any]:
    """Return all of a group by name, as of `find`."""
    return {name: find(group, name, what) for name in names(group)}


def name_of(group: str, thing: type) -> str | None:
    """Return the name under which a class is registered, if it is."""
    return next((entry.name for entry in _entries(group) if entry.value == _path(thing)), None)


def named_like(group: str, path: str) -> str | None:
    """Return the name of the class that an import path, of whatever module, ends with, if one is registered."""
    return next((entry.name for entry in _entries(group) if entry.attr == path.rpartition(":")[2]), None)


def register(group: str, name: str) -> Callable[[T], T]:
    """Return the decorator of a class that makes it known by a name, in this process and those that it starts.

    Raises:
        NgfsiError: something else has this name.
    """

    def decorate(thing: T) -> T:
        _add(EntryPoint(name, _path(thing), group))
        return thing

    return decorate


def plugins() -> tuple[str, ...]:
    """Return what makes the same things known in another process: Python files, and `group name module:object`."""
    ours = {_module_of(path) for path in _files}
    others = (f"{one.group} {one.name} {one.value}" for one in _registered if one.module not in ours)
    return *map(str, _files), *others


def versions() -> dict[str, str]:
    """Return the SHA-256 of each Python file that was loaded, as the version of what it registers."""
    return {str(path): digest for path, digest in _files.items()}


def load(plugins: Iterable[str]) -> None:
    """Make known what another process knew as its `plugins`, or what is registered in Python files.

    Raises:
        NgfsiError: a file cannot be loaded, or registers nothing; or something else has a name already.
    """
    for plugin in plugins:
        if plugin.endswith(".py"):
            _load_file(Path(plugin).resolve())
        else:
            group, name, value = (*plugin.split(" ", 2), "", "")[:3]
            if not value:
                raise NgfsiError(f"'{plugin}' is no plugin: name a Python file, *.py")
            _add(EntryPoint(name, value, group))


def _load_file(path: Path) -> None:
    """Execute a Python file as a module, once."""
    if path in _files:
        return
    name, before = _module_of(path), len(_registered)
    if name in sys.modules:
        raise NgfsiError(f"two plugins are called '{path.name}': give '{path}' another name")
    spec = spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    sys.modules[name] = module_from_spec(spec)
    try:
        spec.loader.exec_module(sys.modules[name])
        if len(_registered) == before:
            raise NgfsiError('it registers nothing: write @register("ngfsi.geometries", "its name") before its class')
    except Exception as error:
        del sys.modules[name], _registered[before:]
        kind = "" if isinstance(error, NgfsiError) else f"{type(error).__name__}: "
        raise NgfsiError(f"the plugin '{path}' cannot be loaded: {kind}{error}") from error
    _files[path] = sha256(path.read_bytes()).hexdigest()


def _add(entry: EntryPoint) -> None:
    if entry in _registered:
        return
    if taken := [other for other in _entries(entry.group) if other.name == entry.name]:
        raise NgfsiError(f"the name '{entry.name}' is taken, by {_origin(taken[0])}: register under another one")
    _registered.append(entry)


def _entries(group: str) -> list[EntryPoint]:
    return [*installed(group), *(entry for entry in _registered if entry.group == group)]


def _origin(entry: EntryPoint) -> str:
    return f"'{entry.value}'" + (f" of the package {entry.dist.name}" if entry.dist else "")


def _path(thing: type) -> str:
    return f"{thing.__module__}:{thing.__qualname__}"


def _module_of(path: Path) -> str:
    return f"plugin_{path.stem}"
