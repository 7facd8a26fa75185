"""Geometries by the names under which they are registered, e.g. `type = "calf"`."""

from __future__ import annotations

from typing import Any

from ngfsi import registry
from ngfsi.config.model import ConfigModel
from ngfsi.errors import GeometryError

GROUP = "ngfsi.geometries"


def find_geometry(name: str) -> type[ConfigModel]:
    """Return the geometry of a name.

    Raises:
        GeometryError: there is none, or what has this name is none.
    """
    if ":" in name and (new := registry.named_like(GROUP, name)):
        raise GeometryError(f"geometries are named, not imported by '{name}': write type = \"{new}\"")
    found = registry.find(GROUP, name, "geometry", GeometryError)
    if not is_geometry(found):
        raise GeometryError(f"'{name}' is registered as a geometry but is no ConfigModel with a method netgen_mesh")
    return found  # type: ignore[no-any-return]


def is_geometry(thing: Any) -> bool:
    """Return whether a class is a geometry, as far as can be told before it meshes."""
    return isinstance(thing, type) and issubclass(thing, ConfigModel) and hasattr(thing, "netgen_mesh")


def name_of(geometry: type[ConfigModel]) -> str:
    """Return the name under which a geometry is registered.

    Raises:
        GeometryError: it is not registered.
    """
    if name := registry.name_of(GROUP, geometry):
        return name
    raise GeometryError(
        f'{geometry.__name__} has no name in case files: write @register("{GROUP}", "its name") before the class'
    )
