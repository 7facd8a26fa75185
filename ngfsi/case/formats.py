"""Versions of the format of case files: which are read, and how a file of an older one is written anew.

The first number changes where a file would be refused, or mean something else; the second where keys are added. A file
that does not name its format is read as one of the present format.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from copy import deepcopy
from math import nan, sqrt
from typing import Any, TypeAlias

from ngfsi import registry
from ngfsi.case.geometries import GROUP
from ngfsi.errors import CaseError
from ngfsi.units import UNITS, from_si, to_si

FORMAT = "1.0"
KEY = "format"
PATTERN = r"^\d{1,3}\.\d{1,3}$"
BEFORE = "0.0"
"""Of files from before formats were numbered."""
SOURCE_WALL = "vein_wall_source"


def reason_not_known(written: Any) -> str:
    """Return why a format is not known here, or nothing if it is."""
    if not isinstance(written, str) or not re.match(PATTERN, written):
        return f'is {written!r}: write two numbers in quotes, as in {KEY} = "{FORMAT}"'
    if _numbers(written) > _numbers(FORMAT):
        return f"is '{written}', and this ngfsi reads '{FORMAT}': install a newer one"
    return ""


def reason_not_read(written: Any) -> str:
    """Return why a file of a format is not read, or nothing if it is."""
    if reason := reason_not_known(written):
        return reason
    if _numbers(written)[0] < _numbers(FORMAT)[0]:
        return f"is '{written}', and this ngfsi reads '{FORMAT}': `ngfsi migrate FILE` writes the case anew"
    return ""


def is_older(case: dict[str, Any]) -> bool:
    """Whether a case that does not name its format holds what no present one does."""
    case = deepcopy(case)
    return any([*step(case)] for step in KEYS_THAT_ARE_GONE)


def _numbers(written: str) -> tuple[int, ...]:
    return tuple(int(number) for number in written.split("."))


def migrated(text: str) -> tuple[str, list[str]]:
    """Return the text of a case file in the present format, with its comments, and what was changed, in sentences.

    Raises:
        CaseError: the text is not TOML, or of a format that this ngfsi does not know.
    """
    import tomlkit
    from tomlkit.exceptions import TOMLKitError

    try:
        case = tomlkit.parse(text)
    except TOMLKitError as error:
        raise CaseError(f"the case file is not valid TOML: {error}") from None
    written = case.unwrap().get(KEY, BEFORE)
    if written == FORMAT:
        return text, []
    if reason := reason_not_known(written):
        raise CaseError(f"'{KEY}' {reason}")
    said = [sentence for major, step in STEPS if _numbers(written)[0] < major for sentence in step(case)]
    if KEY in case:
        case[KEY] = FORMAT
        return tomlkit.dumps(case), said
    return f'{KEY} = "{FORMAT}"\n{tomlkit.dumps(case)}', said


def _table(case: Any, key: str) -> Any:
    """Return a table of a case, or an empty one where there is none: whatever else stands there, `Case` refuses."""
    found = case.get(key)
    return found if isinstance(found, dict) else {}


def _length(value: Any, unit: str) -> float:
    """Return a length (m), or NaN where it is none."""
    known = isinstance(value, int | float) and unit in UNITS
    return to_si(float(value), unit) if known else nan


def _geometries_by_name(case: Any) -> Iterator[str]:
    geometry = _table(case, "geometry")
    path = str(geometry.get("type", ""))
    name = registry.named_like(GROUP, path) if ":" in path else None
    if name:
        geometry["type"] = name
        yield f'geometry.type is a name, "{name}", in place of "{path}"'


def _ratio_of_axes(case: Any) -> Iterator[str]:
    geometry = _table(case, "geometry")
    key = next((key for key in geometry if key == "oval" or key.removeprefix("oval_") in UNITS), None)
    if key is None:
        return
    more = _length(geometry.pop(key), key.removeprefix("oval_"))
    size = next((key for key in geometry if key.startswith("lumen_diameter_")), "")
    unit = size.removeprefix("lumen_diameter_")
    radius = _length(geometry.get(size), unit) / 2
    if not 0 <= more < radius:
        yield f"geometry.{key} is gone, and the vein round: write lumen_axes_mm, the lumen's two axes"
        return
    a, b = radius + more, radius - more
    geometry[size] = float(f"{from_si(2 * sqrt(a * b), unit):.6g}")
    geometry["aspect_ratio"] = float(f"{a / b:.6g}")
    yield f"geometry.aspect_ratio and {size}, that of the circle of the same area, are in place of {key}"


def _smoothing(case: Any) -> Iterator[str]:
    if _table(case, "geometry").pop("pieces", None) is not None:
        yield "geometry.pieces is gone: smoothing_mm, the length over which sections are averaged, has its default"


def _wall_of_the_source(case: Any) -> Iterator[str]:
    for region, material in _table(case, "materials").items():
        if isinstance(material, dict) and material.get("set") == "vein_wall":
            material["set"] = SOURCE_WALL
            yield (
                f'materials.{region}.set is "{SOURCE_WALL}", which is what "vein_wall" was: "vein_wall" now is the law '
                "of the same constants that resists compression"
            )


Step: TypeAlias = Callable[[Any], Iterator[str]]
KEYS_THAT_ARE_GONE: tuple[Step, ...] = (_geometries_by_name, _ratio_of_axes, _smoothing)
"""Steps that change nothing in a case of the present format, and so tell an older one."""
STEPS: tuple[tuple[int, Step], ...] = (*((1, step) for step in KEYS_THAT_ARE_GONE), (1, _wall_of_the_source))
"""The first number of the format that a step leads to, and the step, which changes the case and says how."""
