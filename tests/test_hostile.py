"""Case files from elsewhere: whatever is in them, a case or one sentence; never a traceback, a hang, a foreign file."""

from __future__ import annotations

import copy
import datetime
import math
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st
from ngfsi_geometry import templates

import ngfsi.run.computation
from ngfsi import cli
from ngfsi.case import Case
from ngfsi.errors import CaseError, GeometryError, NgfsiError
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.store import RunFolder
from tests.test_case import TEXT

NUMBER = 2000
FILES = (
    TEXT.replace('type = "calf"', 'type = "tube"'),
    templates.calf(),
)
BASES = [tomllib.loads(text) for text in FILES]

NUMBERS: tuple[Any, ...] = (
    0, -1, 1, 2, 10**30, -(10**400), 0.0, -0.0, 1e-308, 5e-324, 1e308, -1e308, math.nan, math.inf, -math.inf, 0.5,
    10**4000, 2**63, 1e-12, 1e9,
)  # fmt: skip
WORDS: tuple[str, ...] = (
    "", " ", "a", "..", "../../x", "/etc/passwd", "~", "con", "a/b", "a\\b", "a\nb", "a\x1b[2Jb", "a\0b", "ä", "日本",
    "‮abc", "e\u0301", "🦵", "x" * 5000, "${HOME}", "$(touch x)", "%s%n", "{0}", "[bold]", "'; drop", "__class__",
    "self", "os:system",
    "calf", "tube", "beam_in_channel", "ngfsi_geometry.calf:CalfSegment", "ngfsi_geometry.calf:__builtins__",
    "ngfsi_geometry.calf:CalfSegment.mro", "ngfsi_geometry.calf:ConfigModel",
    "subprocess:Popen", "my_vein.py", "ngfsi.geometries calf os:system",
    "mooney_rivlin_s1", "blood", "ramp", "nan", "inf",
)  # fmt: skip
OTHERS: tuple[Any, ...] = (
    True, False, [], {}, [[]], [1, "a"], {"a": {"b": {}}}, [math.nan], datetime.date(2020, 2, 30 - 1),
    datetime.time(1, 2), datetime.datetime(1, 1, 1), {"set": "blood"}, {"law": ["hencky"]}, {"kind": "ramp"},
    {"kind": "table", "times_s": [0, 0], "values_Pa": [1]}, {"kind": "table", "times_s": [], "values_mmHg": []},
)  # fmt: skip


def nested(depth: int) -> Any:
    value: Any = 1
    for level in range(depth):
        value = [value] if level % 2 else {"kind": value}
    return value


def places(table: dict[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    for key, value in table.items():
        yield (*path, key)
        if isinstance(value, dict):
            yield from places(value, (*path, key))


def mutated(rng: np.random.Generator) -> bytes:
    """Return a case file with one or two things wrong: values, keys, tables, or its bytes."""
    data = copy.deepcopy(BASES[rng.integers(2)])
    for _ in range(rng.integers(1, 3)):
        found = list(places(data))
        path = found[rng.integers(len(found))]
        table = data
        for key in path[:-1]:
            table = table[key]
        how = rng.integers(8)
        if how == 0:
            del table[path[-1]]
        elif how == 1:
            table[str(rng.choice(WORDS))] = table[path[-1]]
        elif how == 2:
            table[path[-1]] = nested(int(rng.choice([3, 40, 200])))
        elif how == 3 and isinstance(table[path[-1]], int | float):
            table[path[-1]] *= float(rng.choice([-1, 1e-9, 1e9, 1e300, 1e-300]))
        else:
            values = (NUMBERS, WORDS, OTHERS)[rng.integers(3)]
            table[path[-1]] = copy.deepcopy(values[rng.integers(len(values))])
    sys.set_int_max_str_digits(0)
    content = bytearray(tomli_w.dumps(data).encode("utf-8", "surrogatepass"))
    sys.set_int_max_str_digits(4300)
    if rng.random() < 0.15:
        for _ in range(rng.integers(1, 6)):
            content[rng.integers(len(content))] = rng.integers(256)
    if rng.random() < 0.05:
        del content[rng.integers(len(content)) :]
    return bytes(content)


def check_sentence(error: NgfsiError) -> None:
    """One line fit for a terminal, and the exit code of bad input."""
    assert error.exit_code == 2
    assert str(error).isprintable()
    assert len(str(error)) < 2000, error


def accepted(case: Case, folder: Path, **_: Any) -> None:
    """What is done with a case before it is meshed."""
    RunFolder.create(folder, case).finish("completed")
    assert Case.from_toml(folder / "case.toml") == case
    assert TimeLoop(case, None, None).milestones  # type: ignore[arg-type]
    case.geometry.exact_volumes()


def test_mutated_case_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is accepted, or refused in one line; nothing appears outside of the run's folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(ngfsi.run, "run", accepted)
    monkeypatch.setattr("ngfsi.store.folder.commit", lambda: None)
    monkeypatch.setattr("os.fsync", lambda _: None)
    rng = np.random.default_rng(4)
    codes = []
    for number in range(NUMBER):
        content = mutated(rng)
        Path("case.toml").write_bytes(content)
        try:
            cli.run(Path("case.toml"), Path(f"out/{number}"), quiet=True)
        except NgfsiError as error:
            check_sentence(error)
            codes.append(2)
        else:
            codes.append(0)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["case.toml", "out"]
    assert len(list((tmp_path / "out").iterdir())) == codes.count(0)
    assert NUMBER / 50 < codes.count(0) < NUMBER / 2


VALID: dict[str, st.SearchStrategy[Any]] = {
    "name": st.from_regex(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,30}", fullmatch=True),
    "geometry.lumen_diameter_mm": st.floats(1.0, 15.0),
    "geometry.mesh.lumen_radii": st.sampled_from([(), (0.5,), (0.9, 1 / 3)]),
    "materials.tissue": st.sampled_from([{"set": "neo_hookean_likely"}, {"set": "mooney_rivlin_s1", "K_kPa": 1e2 / 3}]),
    "materials.wall.young_kPa": st.floats(1e-3, 1e6),
    "materials.wall.poisson": st.floats(0.0, 0.49),
    "loads.skin_pressure": st.builds(
        lambda value, rise: {"kind": "smooth_ramp", "final_mmHg": value, "duration_ms": rise},
        st.floats(-1e4, 1e4), st.floats(1e-6, 1e6),
    ),
    "loads.outlet_pressure": st.lists(st.floats(0, 1e5), min_size=1, max_size=5).map(
        lambda values: {"kind": "table", "times_s": [i / 3 for i in range(len(values))], "values_mmHg": values}
    ),
    "loads.inlet_flow.value_ml_min": st.floats(1e-9, 1e9),
    "conditions.ends": st.sampled_from(["roller", "clamped"]),
    "discretisation.order": st.integers(2, 6),
    "time.step_ms": st.floats(0.1, 1000.0),
    "solver.tolerance": st.floats(1e-14, 0.99),
    "output.checkpoint_interval_min": st.floats(1e-6, 1e6),
}  # fmt: skip


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.fixed_dictionaries({}, optional=VALID))
def test_round_trip(changes: dict[str, Any]) -> None:
    """What is written is read as the same case, whatever floats its units and factors make."""
    case = Case.from_dict(BASES[1] | {"time": {"step_ms": 50, "end_s": 2.0}}).replace(**changes)
    again = Case.from_dict(tomllib.loads(case.to_toml()))
    assert again == case
    assert again.digest == case.digest
    assert again.to_toml() == case.to_toml()


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.text(max_size=30), st.one_of(st.text(max_size=30), st.integers(), st.floats(), st.none(), st.booleans()))
def test_changes_on_the_command_line(key: str, value: Any) -> None:
    """`--set` with any text: a case or one sentence."""
    case = Case.from_dict(BASES[0])
    for text in (f"{key}={value}", f"time.{key}={value}", f"name={value}", f"{key}.self={value}"):
        try:
            case.replace(**dict([cli.parse_change(text)]))
        except NgfsiError as error:
            check_sentence(error)


def test_numbers_that_would_take_for_ever() -> None:
    for table, key, value, said in (
        ("time", "step_ms", 1e-12, "more than 1,000,000"),
        ("geometry", "mesh", {"axial_layers": 10**9}, "of at most 2000 is wanted"),
        ("geometry", "mesh", {"vein_size_mm": 1e-9}, "more than 10,000 edges"),
        ("geometry", "mesh", {"far_size_mm": 1e-9}, "more than 10,000 edges"),
    ):
        data = copy.deepcopy(BASES[0])
        data[table][key] = value
        with pytest.raises((CaseError, GeometryError), match=said):
            Case.from_dict(data)
