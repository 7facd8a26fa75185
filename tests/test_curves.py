"""Curves in time: values, ends, breakpoints, and how they are written."""

from __future__ import annotations

from math import pi, sin
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ngfsi.config.functions import (
    FlowConstant,
    FlowCurve,
    FlowHarmonics,
    PressureConstant,
    PressureCurve,
    PressureRamp,
    PressureSmoothRamp,
    PressureTable,
)
from ngfsi.config.model import ConfigModel
from ngfsi.errors import CaseError

KINDS = "'constant', 'ramp', 'smooth_ramp', 'table', 'harmonics', 'waveform', 'hydrostatic'"


class Loads(ConfigModel):
    """A section with curves."""

    skin: PressureCurve
    inlet: FlowCurve = FlowConstant(value=1e-6)


def skin(**written: object) -> PressureConstant | PressureRamp | PressureTable:
    return Loads.from_dict({"skin": written}).skin


def test_constant() -> None:
    curve = skin(kind="constant", value_mmHg=10)
    assert curve == PressureConstant(value=1333.22)
    assert curve(-1.0) == curve(5.0) == 1333.22
    assert curve.breakpoints == ()


def test_ramp() -> None:
    curve = skin(kind="ramp", initial_Pa=100, final_kPa=1.1, start_s=0.5, duration_s=2)
    assert [curve(t) for t in (-1, 0.5, 1.0, 1.5, 2.5, 9)] == pytest.approx([100, 100, 350, 600, 1100, 1100], rel=1e-15)
    assert curve(2.5) == 1100.0
    assert curve.breakpoints == (0.5, 2.5)
    assert PressureRamp(initial=1, final=1, duration=1).breakpoints == ()


def test_ramp_reaches_the_load_of_the_study_exactly() -> None:
    curve = skin(kind="ramp", final_mmHg=25, duration_s=1.0)
    assert curve(0.0) == 0.0
    assert curve(1.0) == curve(1.5) == 3333.05


def test_table() -> None:
    curve = skin(kind="table", times_s=[1, 2, 3, 5], values_kPa=[1, 2, 3, 1])
    assert [curve(t) for t in (0, 1, 1.5, 2, 4, 5, 6)] == pytest.approx(
        [1e3, 1e3, 1.5e3, 2e3, 2e3, 1e3, 1e3], rel=1e-15
    )
    assert curve.breakpoints == (1.0, 3.0, 5.0)  # the slope goes on at 2
    straight = PressureTable(times=(0.1, 0.2, 0.3, 0.4), values=(0.1, 0.2, 0.3, 0.4))
    assert straight.breakpoints == (0.1, 0.4)  # rounding of the slopes makes no bend
    assert PressureTable(times=(0.0,), values=(7.0,)).breakpoints == ()
    assert PressureTable(times=(0.0,), values=(7.0,))(3.0) == 7.0
    assert PressureTable(times=(0.0, 1.0, 2.0), values=(7.0, 7.0, 8.0)).breakpoints == (1.0, 2.0)


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=6), st.floats(-1, 7))
def test_table_stays_between_its_neighbours_and_meets_its_points(values: list[float], t: float) -> None:
    curve = PressureTable(times=[float(i) for i in range(len(values))], values=values)
    assert min(values) - 1e-9 <= curve(t) <= max(values) + 1e-9
    assert [curve(float(i)) for i in range(len(values))] == values


def test_smooth_ramp_starts_and_ends_level() -> None:
    curve = PressureSmoothRamp(initial=100.0, final=500.0, start=1.0, duration=2.0)
    assert [curve(t) for t in (0.0, 1.0, 2.0, 3.0, 9.0)] == pytest.approx([100, 100, 300, 500, 500], rel=1e-15)
    assert curve(1.5) == pytest.approx(100 + 400 * (1 - 0.5**0.5) / 2, rel=1e-14)
    assert curve.breakpoints == ()


def test_round_trip() -> None:
    for curve in (
        PressureConstant(value=0.1),
        PressureRamp(final=1 / 3, duration=0.7),
        PressureSmoothRamp(final=1 / 3, duration=0.7),
        PressureTable(times=(0.1,), values=(1 / 3,)),
    ):
        loads = Loads(skin=curve)
        assert Loads.from_dict(loads.to_toml_dict()) == loads


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ({"kind": "rmp"}, "'skin.kind' has an unknown value: 'rmp' is not a known kind: did you mean 'ramp'?"),
        ({}, f"'skin.kind' is missing: write one of {KINDS}"),
        (5, f"skin = 5 is not accepted: a table with kind = one of {KINDS} is wanted"),
        ({"kind": "constant", "value_ml_s": 1}, "'skin.value_ml_s' has a unit of flow rate: write 'value_Pa' or"),
        ({"kind": "ramp", "final_Pa": 1}, "'skin.duration_s' is missing: write 'duration_s' or 'duration_ms'"),
        ({"kind": "ramp", "final_Pa": 1, "duration_s": 0}, "skin.duration_s = 0 is not accepted: a number greater"),
        ({"kind": "table", "times_s": [], "values_Pa": []}, "skin.times_s = [] is not accepted"),
        ({"kind": "table", "times_s": [0, 1], "values_Pa": [1]}, "skin: a table needs as many times as values"),
        ({"kind": "table", "times_s": [0, 1, 1], "values_Pa": [1, 2, 3]}, "skin: the times of a table must increase"),
    ],
)
def test_refused(written: object, said: str) -> None:
    with pytest.raises(CaseError) as caught:
        Loads.from_dict({"skin": written})
    assert str(caught.value).startswith(said)


def test_a_flow_is_no_pressure() -> None:
    with pytest.raises(CaseError, match="skin = a Constant is not accepted"):
        Loads(skin=FlowConstant(value=1.0))


def test_harmonics() -> None:
    loads = Loads.from_dict(
        {
            "skin": {"kind": "constant", "value_Pa": 0},
            "inlet": {"kind": "harmonics", "mean_ml_s": 3, "amplitudes_ml_s": [1, 0.5], "phases_deg": [0, 90],
                      "period_s": 4},
        }
    )  # fmt: skip
    # cos(pi/2 t) - 0.5 sin(pi t)
    assert [loads.inlet(t) for t in (0, 0.5, 1, 2, 4.5)] == pytest.approx(
        [4e-6, 3e-6 + 1e-6 * (0.5**0.5 - 0.5), 3e-6, 2e-6, 3e-6 + 1e-6 * (0.5**0.5 - 0.5)], rel=1e-12
    )
    assert loads.inlet.breakpoints == ()
    with pytest.raises(CaseError, match="as many phases as amplitudes, not 1 and 2"):
        FlowHarmonics(mean=1.0, amplitudes=(1.0, 2.0), phases=(0.0,), period=1.0)


def test_a_waveform_from_a_file(tmp_path: Path) -> None:
    """Every point of it, in every period; between them smooth, and the mean of a sine is not lost."""
    times = [k / 10 for k in range(21)]
    rows = [f"{t},{3 + sin(pi * t)}" for t in times[:-1]] + ["2.0,3.0"]
    file = tmp_path / "inflow.csv"
    file.write_text("\n".join(["time_s,flow_ml_s", *rows, ""]))
    written = {"skin": {"kind": "constant", "value_Pa": 0}, "inlet": {"kind": "waveform", "file": str(file)}}
    curve = Loads.from_dict(written).inlet
    for t in (0.0, 0.3, 1.25, 1.95, 2.3, 7.3, -0.7):
        assert curve(t) == pytest.approx(1e-6 * (3 + sin(pi * t)), rel=1e-5)
    assert curve.breakpoints == ()
    # the resolved case needs the file no more
    file.unlink()
    again = Loads.from_dict({"skin": written["skin"], "inlet": curve.to_toml_dict()}).inlet
    assert again == curve
    assert again(0.77) == curve(0.77)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("t,q\n0,1\n1,2\n", "needs 2 columns below a head with units"),
        ("time_s,flow_ml_s\n0,1\n1,two\n", "line 3: 'two' in column 'flow_ml_s' is not a finite number"),
        ("time_s,flow_ml_s\n0,1\n1,2\n2,4\n3,3\n", "last value of a waveform must repeat the first"),
        ("time_s,flow_ml_s\n0,1\n1,2\n1,4\n3,1\n", "must increase"),
        ("time_s,flow_kPa\n0,1\n1,2\n2,4\n3,1\n", "has a unit of pressure"),
    ],
)
def test_bad_waveforms(tmp_path: Path, text: str, complaint: str) -> None:
    file = tmp_path / "inflow.csv"
    file.write_text(text)
    with pytest.raises(CaseError, match=complaint):
        Loads.from_dict({"skin": {"kind": "constant", "value_Pa": 0}, "inlet": {"kind": "waveform", "file": str(file)}})
    with pytest.raises(CaseError, match="cannot be read"):
        Loads.from_dict({"skin": {"kind": "constant", "value_Pa": 0}, "inlet": {"kind": "waveform", "file": "nowhere"}})
