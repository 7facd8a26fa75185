"""Sections: units in keys, strict types, exact round trips, and errors in the user's own terms."""

from __future__ import annotations

import pickle
import tomllib
from typing import Any, Literal, Self

import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field, ValidationError, model_validator

from ngfsi.config.model import ConfigModel
from ngfsi.errors import CaseError, GeometryError
from ngfsi.units import Length, Pressure, Time


class Tube(ConfigModel):
    """A section with every kind of field."""

    diameter: Length = Field(gt=0, lt=0.05)
    wall: Length | None = None
    times: tuple[Time, ...] = ()
    box: tuple[Length, Length] = (0.0, 0.0)
    layers: int = 1
    factor: float = 1.0
    open: bool = False
    side: Literal["left", "right"] = "left"


class Pump(ConfigModel):
    """A nested section with a rule of its own and a value computed from another."""

    refusal = GeometryError

    tube: Tube
    tubes: tuple[Tube, ...] = ()
    low: Pressure
    high: Pressure = Field(default_factory=lambda given: 2 * given["low"])

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.high < self.low:
            raise ValueError("the high pressure lies below the low one")
        return self


def refused(data: dict[str, Any], cls: type[ConfigModel] = Tube) -> str:
    with pytest.raises((CaseError, GeometryError)) as caught:
        cls.from_dict(data, source="x.toml")
    text = str(caught.value)
    assert text.startswith("x.toml: ")
    assert "\n" not in text
    assert "pydantic" not in text
    return text.removeprefix("x.toml: ")


def test_units_in_keys_give_si() -> None:
    tube = Tube.from_dict({"diameter_mm": 11.1, "wall_cm": 1, "times_ms": [0, 250], "box_mm": [1, 2.5]})
    assert tube == Tube(diameter=0.0111, wall=0.01, times=(0.0, 0.25), box=(0.001, 0.0025))
    assert isinstance(tube.wall, float)
    assert tube.times == (0.0, 0.25)


def test_written_in_si_without_what_is_not_given() -> None:
    written = Pump(tube=Tube(diameter=0.0111, times=[0.0, 1.5]), low=1.0).to_toml_dict()
    assert written == {
        "tube": {
            "diameter_m": 0.0111,
            "times_s": [0.0, 1.5],
            "box_m": [0.0, 0.0],
            "layers": 1,
            "factor": 1.0,
            "open": False,
            "side": "left",
        },
        "tubes": [],
        "low_Pa": 1.0,
        "high_Pa": 2.0,
    }


finite = st.floats(allow_nan=False, allow_infinity=False)


@given(st.floats(min_value=1e-300, max_value=0.049), st.lists(finite, max_size=4), finite, st.none() | finite)
def test_round_trip_through_toml_is_bitwise(
    diameter: float, times: list[float], factor: float, wall: float | None
) -> None:
    tube = Tube(diameter=diameter, times=times, factor=factor, wall=wall)
    text = tomli_w.dumps(tube.to_toml_dict())
    assert Tube.from_dict(tomllib.loads(text)) == tube
    assert pickle.loads(pickle.dumps(tube)) == tube


def test_keys_that_are_refused() -> None:
    ok = {"diameter_mm": 1}
    assert refused({}) == (
        "'diameter_m' is missing: write 'diameter_m' or 'diameter_cm' or 'diameter_mm' or 'diameter_um'"
    )
    assert refused({"diameter": 1}).startswith("'diameter' needs its unit in the key: write 'diameter_m' or ")
    assert refused({"diameter_kPa": 1}).startswith("'diameter_kPa' has a unit of pressure: write 'diameter_m' or ")
    assert (
        refused(ok | {"diameter_m": 1e-3})
        == "'diameter_m' is given twice: 'diameter_mm' is the same quantity, keep one of them"
    )
    assert "'diametr_mm' is not a known key: did you mean 'diameter_mm'? accepted here are " in refused(
        {"diametr_mm": 1}
    )
    assert "did you mean 'diameter_mm'?" in refused({"diameter_MM": 1})
    assert refused(ok | {"zzz": 1}) == (
        "'zzz' is not a known key: accepted here are diameter_m, wall_m, times_s, box_m, layers, factor, open, side"
    )
    assert refused({"low_Pa": 1}, Pump) == "'tube' is missing: a Pump needs it"


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("wall_mm", "5", "wall_mm = '5' is not accepted: a number is wanted"),
        ("wall_mm", True, "wall_mm = true is not accepted: a number is wanted"),
        ("wall_mm", float("nan"), "wall_mm = nan is not accepted: a finite number is wanted"),
        ("wall_mm", float("inf"), "wall_mm = inf is not accepted: a finite number is wanted"),
        ("wall_mm", {"a": 1}, "wall_mm = { a } is not accepted: a number is wanted"),
        ("diameter_mm", 60, "diameter_mm = 60 is not accepted: a number less than 50 is wanted"),
        ("diameter_cm", 60, "diameter_cm = 60 is not accepted: a number less than 5 is wanted"),
        ("diameter_mm", -1, "diameter_mm = -1 is not accepted: a number greater than 0 is wanted"),
        ("times_s", 1, "times_s = 1 is not accepted: a list in brackets is wanted"),
        ("times_s", [0, "1"], "times_s[1] = '1' is not accepted: a number is wanted"),
        ("layers", 2.0, "layers = 2.0 is not accepted: a whole number is wanted"),
        ("layers", True, "layers = true is not accepted: a whole number is wanted"),
        ("factor", True, "factor = true is not accepted: a number is wanted"),
        ("open", 1, "open = 1 is not accepted: true or false is wanted"),
        ("side", "rigth", "side = 'rigth' is not accepted: did you mean 'right'? one of 'left', 'right' is wanted"),
    ],
)
def test_values_that_are_refused(key: str, value: object, said: str) -> None:
    given = {} if key.startswith("diameter") else {"diameter_mm": 1}
    assert refused(given | {key: value}) == said


def test_lists_of_the_wrong_length() -> None:
    assert refused({"diameter_mm": 1, "box_mm": [1]}) == "box_mm[1] is missing: the list is too short"
    assert refused({"diameter_mm": 1, "box_mm": [1, 2, 3]}).endswith(": a list of at most 2 is wanted")


def test_nested_errors_carry_the_whole_path() -> None:
    ok = {"tube": {"diameter_mm": 1}, "low_Pa": 1}
    assert refused(ok | {"tube": {"diameter_mm": "1"}}, Pump).startswith("tube.diameter_mm = '1' is not accepted")
    assert refused(ok | {"tube": {"diameter": 1}}, Pump).startswith("'tube.diameter' needs its unit")
    assert refused(ok | {"tube": 5}, Pump) == "tube = 5 is not accepted: a table of keys is wanted"
    assert refused(ok | {"tubes": [{"diameter_mm": 1}, {"diameter_mm": 0}]}, Pump).startswith(
        "tubes[1].diameter_mm = 0"
    )
    assert refused(ok | {"high_Pa": 0.5}, Pump) == "the high pressure lies below the low one"
    # the default of `high` depends on `low`: its failure is not reported beside the cause
    assert refused(ok | {"low_Pa": "x"}, Pump) == "low_Pa = 'x' is not accepted: a number is wanted"
    assert refused({"tube": {"diameter_mm": 0, "layers": 1.5}, "low_Pa": 1}, Pump).endswith(" (and 1 more)")


def test_constructor_takes_si_and_explains_too() -> None:
    assert Tube(diameter=0.01) == Tube(diameter_mm=10)
    with pytest.raises(CaseError, match=r"^Tube: diameter = -1 is not accepted: a number greater than 0 is wanted$"):
        Tube(diameter=-1)
    with pytest.raises(GeometryError, match=r"^Pump: tube\.diameter = 1 is not accepted"):
        Pump(tube={"diameter": 1}, low=1.0)


def test_frozen() -> None:
    with pytest.raises(ValidationError):
        Tube(diameter=0.01).diameter = 0.02  # type: ignore[misc]


def test_replace() -> None:
    pump = Pump(tube=Tube(diameter=0.01), low=1.0)
    assert pump.replace(low=3.0) == Pump(tube=Tube(diameter=0.01), low=3.0, high=6.0)  # the default follows
    assert pump.replace(high=9.0).replace(low=3.0).high == 9.0
    changed = pump.replace(**{"tube.diameter_mm": 5, "tube.layers": 3, "low_kPa": 1})
    assert changed == Pump(tube=Tube(diameter=0.005, layers=3), low=1000.0)
    assert pump.replace(tube=Tube(diameter=0.02)).tube.diameter == 0.02
    assert pump.tube.diameter == 0.01


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("tube.diametr", 1, "'tube.diametr' is not a known key: did you mean 'diameter_m'?"),
        ("tbe.diameter", 1, "'tbe' is not a known key: did you mean 'tube'?"),
        ("low.x", 1, "'low' holds no keys"),
        ("tube.diameter", -1, "tube.diameter = -1 is not accepted"),
        ("tube", 3, "tube = 3 is not accepted: a table of keys is wanted"),
        ("high", 0.1, "the high pressure lies below the low one"),
    ],
)
def test_replace_refuses_with_the_path(path: str, value: object, said: str) -> None:
    pump = Pump(tube=Tube(diameter=0.01), low=1.0)
    with pytest.raises((CaseError, GeometryError)) as caught:
        pump.replace(**{path: value})
    assert str(caught.value).startswith(said)


def test_replace_refuses_a_part_and_its_whole_together() -> None:
    pump = Pump(tube=Tube(diameter=0.01), low=1.0)
    for changes in ({"tube": pump.tube, "tube.layers": 2}, {"tube.layers": 2, "tube": pump.tube}):
        with pytest.raises(CaseError, match="cannot be changed together"):
            pump.replace(**changes)
