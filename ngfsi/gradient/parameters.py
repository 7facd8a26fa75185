"""Parameters of a case by the path of their key, and cases in which one of them is another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

from ngfsi.case import Case
from ngfsi.config.functions import Curve, Waveform
from ngfsi.config.model import ConfigModel, dimension_of_field, keys_of
from ngfsi.errors import CaseError, NgfsiError, unknown
from ngfsi.units import SI_SUFFIX, to_si

ROOMS = ("materials", "loads", "conditions", "geometry")
"""Parts of a case whose numbers are parameters of the model."""
RELATIVE_STEP = 1e-5
"""Of a parameter, or of its distance to the end of its range (a Poisson ratio of 0.499), in the central differences of
the residual: their error is its square, and rounding of the same size."""


@dataclass(frozen=True)
class Parameter:
    """A number of a case.

    Attributes:
        path: keys and numbers of list entries, in the names of the fields.
        value: SI.
        unit: suffix of its SI unit; "1" for pure numbers.
        step: by which it is varied, SI.
    """

    path: tuple[str, ...]
    value: float
    unit: str
    step: float

    @property
    def name(self) -> str:
        """The path as it is written."""
        return ".".join(self.path)

    def can_vary(self, case: Case) -> bool:
        """Whether the value can be larger and smaller."""
        try:
            self.varied(case)
        except CaseError:
            return False
        return True

    def varied(self, case: Case) -> tuple[Case, Case]:
        """Return the case with a larger and with a smaller value.

        Raises:
            CaseError: the value lies at the end of what is allowed.
        """
        try:
            more, less = (changed(case, self.path, self.value + sign * self.step) for sign in (1, -1))
        except NgfsiError as error:
            raise CaseError(f"--by {self.name}: {self.value:g} can be varied to one side only: {error}") from None
        return more, less


def parameters_of(case: Case, wanted: Sequence[str]) -> list[Parameter]:
    """Return the parameters that are asked for: numbers, or all numbers under a key.

    Of functions of time the values are parameters, but not the times, to which the steps are fitted. Of all numbers
    under a key those are left out that lie at the end of what is allowed, as a density of 0.

    Raises:
        CaseError: a key is unknown, or no parameter.
    """
    found: dict[str, Parameter] = {}
    for written in wanted:
        keys = written.split(".")
        if keys[0] not in ROOMS:
            raise CaseError(f"--by {written}: {unknown('part of a case with parameters', keys[0], ROOMS)}")
        path, part = _resolved(case, keys, written)
        among = [one for one in _numbers(case, path, part) if isinstance(part, float) or one.can_vary(case)]
        if not among:
            raise CaseError(f"--by {written}: there is no number that the result depends on smoothly: name one such as "
                            "materials.tissue or loads.skin_pressure.value")  # fmt: skip
        found |= {one.name: one for one in among}
    return list(found.values())


def _resolved(case: Case, keys: Sequence[str], written: str) -> tuple[tuple[str, ...], Any]:
    """Return the path in the names of the fields, and what is there."""
    part: Any = case
    path: list[str] = []
    for key in keys:
        known = _parts(part)
        if isinstance(part, ConfigModel) and (spelled := keys_of(type(part)).get(key)):
            key = spelled.field
        if key not in known:
            raise CaseError(f"--by {written}: {unknown('key', key, known)}")
        path.append(key)
        part = known[key]
    return tuple(path), part


def _parts(part: Any) -> dict[str, Any]:
    if isinstance(part, ConfigModel):
        return {name: getattr(part, name) for name in type(part).model_fields}
    if isinstance(part, Mapping):
        return dict(part)
    return {str(n): one for n, one in enumerate(part)} if isinstance(part, tuple) else {}


def _numbers(case: Case, path: tuple[str, ...], part: Any) -> Iterator[Parameter]:
    if isinstance(part, float):
        owner, field = _owner(case, path)
        dimension = dimension_of_field(type(owner), field)
        closes = isinstance(owner, Waveform) and field == "values" and int(path[-1]) == len(owner.values) - 1
        if not (isinstance(owner, Curve) and dimension == "time") and not closes:
            size = min(abs(part) or _scale(case, path), *_distances(owner, field, part))
            yield Parameter(path, part, SI_SUFFIX[dimension] if dimension else "1", RELATIVE_STEP * size)
    for key, inside in _parts(part).items():
        yield from _numbers(case, (*path, key), inside)


def _owner(case: Case, path: tuple[str, ...]) -> tuple[ConfigModel, str]:
    """Return the part of a case that has a number, or the list in which it is, and under which key."""
    owner: Any = case
    found: tuple[ConfigModel, str] = case, path[0]
    for key in path:
        found = (owner, key) if isinstance(owner, ConfigModel) else found
        owner = _parts(owner)[key]
    return found


def _distances(owner: ConfigModel, field: str, value: float) -> list[float]:
    """Return the distances of a number to the ends of its range."""
    return [abs(value - end) for end in _ends(owner, field) if value != end]


def _ends(owner: ConfigModel, field: str) -> tuple[float, float]:
    """Return the range of a number."""
    ends = {"gt": -inf, "ge": -inf, "lt": inf, "le": inf}
    for limit in type(owner).model_fields[field].metadata:
        ends |= {name: getattr(limit, name) for name in ends if hasattr(limit, name)}
    return max(ends["gt"], ends["ge"]), min(ends["lt"], ends["le"])


def bounds_of(case: Case, parameter: Parameter) -> tuple[float, float]:
    """Return the range of a parameter by its own definition (SI)."""
    return _ends(*_owner(case, parameter.path))


def two_numbers(case: Case, written: str, option: str) -> tuple[str, tuple[float, float]]:
    """Return the name of a parameter and the two numbers (SI) that are written as KEY=NUMBER,NUMBER.

    The unit is that of the key, as in `materials.tissue.K_kPa=30,5`; SI without one.

    Raises:
        CaseError: it is not written so, or the key is none of a number.
    """
    key, _, numbers = written.partition("=")
    try:
        first, second = map(float, numbers.split(","))
    except ValueError:
        raise CaseError(f"{option} {written} is not understood: write KEY=NUMBER,NUMBER, e.g. "
                        "materials.tissue.K_kPa=30,5") from None  # fmt: skip
    keys = key.split(".")
    path, part = _resolved(case, keys, key)
    if not isinstance(part, float):
        raise CaseError(f"{option} {written}: '{key}' is no number")
    owner, field = _owner(case, path)
    unit = keys_of(type(owner))[keys[len(path) - 1 - path[::-1].index(field)]].unit
    return ".".join(path), (first, second) if unit is None else (to_si(first, unit), to_si(second, unit))


def _scale(case: Case, path: tuple[str, ...]) -> float:
    """Return a size by which a parameter is varied whose value is 0: that of the numbers beside it, or 1."""
    part: Any = case
    for key in path[:-1]:
        part = _parts(part)[key]
    return max((abs(one) for one in _parts(part).values() if isinstance(one, float)), default=0.0) or 1.0


def changed(part: Any, path: tuple[str, ...], value: float) -> Any:
    """Return a part of a case with another number at a path."""
    if not path:
        return value
    key, inside = path[0], changed(_parts(part)[path[0]], path[1:], value)
    if isinstance(part, Waveform) and key == "values":
        inside = (*inside[:-1], inside[0])  # the last value closes the period
    if isinstance(part, ConfigModel):
        return part.replace(**{key: inside})
    if isinstance(part, Mapping):
        return {**part, key: inside}
    return (*part[: int(key)], inside, *part[int(key) + 1 :])
