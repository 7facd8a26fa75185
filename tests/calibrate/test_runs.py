"""Calibration by whole runs: known constants come back, from waves in a ring and from areas of a vein in 3-D."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ngfsi.case import Case
from ngfsi.cli import main
from ngfsi.config.functions import PressureRamp
from ngfsi.errors import CaseError, MaterialError, OutputError
from ngfsi.gradient import calibration
from ngfsi.gradient.adjoint import Adjoint
from ngfsi.gradient.calibration import Datum, Runs, calibrate, read_data
from ngfsi.gradient.parameters import parameters_of, two_numbers
from ngfsi.gradient.window import Window
from ngfsi.mesh.domain import Domain
from ngfsi.store.table import read_rows
from tests.gradient.test_gradient import VEIN, WAVES
from tests.vein import Array, domain_of

BY = ("materials.tissue.young", "materials.tissue.density")
TIMES = (0.003, 0.004, 0.006, 0.008, 0.01)
"""One of them between steps."""


def twin(case: Case, names: tuple[str, ...], error: float = 1e-3, times: tuple[float, ...] = TIMES) -> Runs:
    """Return runs whose data are those of the case itself, with relative errors."""
    data = [Datum("skin_area_loss", "skin_area", Window("loss", end=t), 0.0, 1.0, "1") for t in times]
    runs = Runs(case, parameters_of(case, names), data, domain=domain_of(case.geometry))
    exact = runs.values(np.array([one.value for one in runs.parameters]))
    data = [Datum(one.name, one.quantity, one.window, value, error * abs(value), "1")
            for one, value in zip(data, exact.tolist(), strict=True)]  # fmt: skip
    return Runs(case, runs.parameters, data, domain=runs.domain)


@pytest.fixture(scope="module")
def waves() -> Runs:
    return twin(WAVES, BY)


def values_of(runs: Runs) -> Array:
    return np.array([one.value for one in runs.parameters])


def test_exact_data_give_the_constants_back(waves: Runs) -> None:
    """Young's modulus and density from a wave, from trials 30 % away."""
    truth = values_of(waves)
    away = waves.case_of(truth * [1.3, 0.7])
    runs = Runs(away, parameters_of(away, BY), waves.data, domain=waves.domain)
    found = calibrate(runs)
    assert found.values == pytest.approx(truth, rel=1e-5)
    assert runs.runs <= 20


def test_slopes_by_sweeps_are_those_by_differences(waves: Runs) -> None:
    """The two ways to the same derivatives; a sweep for all data at once gives the gradient of the misfit."""
    truth = values_of(waves)
    present = waves.values(truth)
    assert waves._last is not None
    run, weights = waves._last[1], waves._last[3]
    by_sweeps, by_differences = waves.by_sweeps(run, weights), waves.by_differences(truth, present)
    assert np.all(np.abs(by_sweeps - by_differences) < 2e-4 * np.abs(by_sweeps).max(axis=0))
    gaps = np.array([1.0, -2.0, 0.5, 3.0, -1.0])
    whole = Adjoint(run, waves.parameters).derivatives({"skin_area": gaps @ np.array(weights)})
    assert whole == pytest.approx(gaps @ by_sweeps, rel=1e-6)


def test_the_cheaper_way_is_taken(waves: Runs) -> None:
    """Two parameters by two more runs; many by a sweep for one datum, and in equilibria one touches its state only."""
    waves.values(values_of(waves))
    assert waves.sweeps_cost == pytest.approx((3 + 3 + 4 + 5 + 6) / 6 * 1.46)
    case = WAVES.replace(**{"time.scheme": "static"})
    runs = twin(case, ("materials.tissue.young", "materials.tissue.poisson"), times=(0.004,))
    runs.slopes(values_of(runs))
    assert (runs.runs, runs.sweeps) == (1, 1)


def test_what_the_data_do_not_tell_is_refused() -> None:
    """At rest a modulus and the load are one number; with one of them known, the other is."""
    case = WAVES.replace(**{"time.scheme": "static", "time.step": 4e-3, "time.end": 4e-3})
    runs = twin(case, ("materials.tissue.young", "loads.skin_pressure.final"), times=(0.002, 0.004))
    with pytest.raises(MaterialError, match=r"do not tell these parameters apart: .* loads.skin_pressure.final"):
        calibrate(runs)
    found = calibrate(runs, priors={"loads.skin_pressure.final": (500.0, 5.0)})
    assert found.sd[0] / found.values[0] == pytest.approx(np.hypot(0.01, 1e-3 / 2**0.5), rel=0.02)
    with pytest.raises(CaseError, match=r"'materials.tissue.poisson' is not a known parameter of --by"):
        calibrate(runs, bounds={"materials.tissue.poisson": (0.1, 0.2)})


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Areas of a vein by height and pressure on its leg: the stiffness of the tissue comes back within its interval."""
    case = VEIN.replace(**{
        "name": "twin", "time.scheme": "static", "time.end": 0.1,
        "loads.skin_pressure": PressureRamp(final=1e3, duration=0.1),
    })  # fmt: skip
    parameter = parameters_of(case, ["materials.tissue.young"])
    data = [Datum("", name, Window(end=0.1), 0.0, 1.0, "m2") for name in ("area_at_3mm", "area_at_7.5mm")]
    areas = 1e6 * Runs(case, parameter, data, domain=domain_of(case.geometry)).values(np.array([30e3]))
    table = tmp_path / "areas.csv"
    table.write_text("height_mm,skin_pressure_Pa,area_mm2,area_error_mm2\n"
                     f"3,1000,{areas[0] + 0.01},0.02\n7.5,1000,{areas[1] - 0.01},0.02\n7.5,0,,\n")  # fmt: skip
    (tmp_path / "case.toml").write_text(case.to_toml())
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", str(tmp_path / "case.toml"), "--data", str(table), "--by", "materials.tissue.young", "-o",
              str(tmp_path / "out"), "--set", "materials.tissue.young_kPa=40", "--quiet",
              "--bounds", "materials.tissue.young_kPa=5,100", "--check", "2"])  # fmt: skip
    assert not ended.value.code
    (row,) = read_rows(tmp_path / "out" / "calibration.csv")
    assert float(row["low"]) < 30e3 < float(row["high"])
    assert row["start"] == 40e3
    assert Case.from_toml(tmp_path / "out" / "case.toml").materials.tissue.young == row["value"]  # type: ignore[union-attr]
    gaps = [float(one["gap_over_error"]) for one in read_rows(tmp_path / "out" / "data.csv")]
    assert sum(gaps) == pytest.approx(0.0, abs=0.05)
    assert np.ptp(gaps) == pytest.approx(1.0, abs=0.05)
    drawn = read_rows(tmp_path / "out" / "check.csv")
    assert len(drawn) == 2
    middle = float(read_rows(tmp_path / "out" / "data.csv")[0]["calibrated"])
    for one in drawn:  # blood presses more than the leg: a stiffer tissue is widened less
        stiffer = float(one["materials.tissue.young_Pa"]) > float(row["value"])
        assert (float(one["area_at_3mm_at_0.1s_m2"]) < middle) is stiffer
    text = (tmp_path / "out" / "report.md").read_text()
    assert "2 runs of parameters drawn from their covariance" in text
    assert "| `materials.tissue.young` | Pa |" in text
    assert "for 2 data, 1 more than parameters without a prior" in text
    assert (tmp_path / "out" / "calibration.png").stat().st_size > 1000
    assert "95 % interval" in capsys.readouterr().out


REFUSED = {
    "no time": ("skin_area_mm2,skin_area_error_mm2\n1,1\n", "needs one column, time_s or skin_pressure_mmHg"),
    "late": ("time_ms,skin_area_mm2,skin_area_error_mm2\n11,1,1\n", "within the run, from 0 to 0.01 s"),
    "no error": ("time_s,skin_area_mm2\n0,1\n", "add a column skin_area_error_mm2"),
    "error of 0": ("time_s,skin_area_mm2,skin_area_error_mm2\n0,1,0\n", "of 'skin_area' in row 1 is not above 0"),
    "empty": ("time_s,skin_area_mm2,skin_area_error_mm2\n0,,1\n", "holds no measured values"),
    "pressure": ("skin_pressure_kPa,skin_area_mm2,skin_area_error_mm2\n1,1,1\n", "no pressure of 1000 Pa on the skin"),
    "dimension": ("time_mm,skin_area_mm2,skin_area_error_mm2\n1,1,1\n", "has no unit of time"),
    "no unit": ("time_s,skin_area\n1,1\n", "the column 'skin_area' has no unit"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_data_that_are_refused(name: str, tmp_path: Path) -> None:
    text, sentence = REFUSED[name]
    (tmp_path / "data.csv").write_text(text)
    with pytest.raises((CaseError, OutputError), match=sentence):
        read_data(tmp_path / "data.csv", WAVES)


def test_data_as_they_are_read(tmp_path: Path) -> None:
    """In SI; a pressure is that of its first time, and empty cells are nothing."""
    path = tmp_path / "data.csv"
    path.write_text("skin_pressure_Pa,skin_area_cm2,skin_area_error_mm2,tissue_area_loss_percent,tissue_area_loss_error_1\n"
                    "125,12,3,,\n500,,,2,0.01\n")  # fmt: skip
    first, second = read_data(path, WAVES)
    assert (first.quantity, first.window.kind, first.unit) == ("skin_area", "end", "m2")
    assert (first.value, first.error, first.time) == pytest.approx((12e-4, 3e-6, 1e-3), rel=1e-12)
    assert (second.quantity, second.window.kind, second.name) == ("tissue_area", "loss", "tissue_area_loss")
    assert (second.value, second.error, second.time) == pytest.approx((0.02, 0.01, 4e-3), rel=1e-12)


def test_numbers_of_bounds_and_priors() -> None:
    """With the unit of the key, in lists too."""
    assert two_numbers(VEIN, "materials.tissue.young_kPa=30,5", "--prior") == ("materials.tissue.young", (30e3, 5e3))
    assert two_numbers(VEIN, "materials.tissue.young=30,5", "--prior") == ("materials.tissue.young", (30.0, 5.0))
    with pytest.raises(CaseError, match=r"--prior materials.tissue.young=3 is not understood"):
        two_numbers(VEIN, "materials.tissue.young=3", "--prior")
    with pytest.raises(CaseError, match=r"'materials.tissue' is no number"):
        two_numbers(VEIN, "materials.tissue=3,4", "--prior")


def test_another_mesh_is_taken_where_the_elements_are_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Far from the first trial a number of the geometry may mean other elements, near it for a derivative never."""
    case = WAVES.replace(**{"time.scheme": "static", "time.step": 4e-3, "time.end": 4e-3})
    data = [Datum("skin_area", "skin_area", Window(end=4e-3), 1e-4, 1e-5, "m2")]
    runs = Runs(case, parameters_of(case, ["geometry.mesh.far_size"]), data, domain=domain_of(case.geometry))
    first = runs.domain
    taken: list[tuple[Domain, str]] = []

    def other(_case: Case, domain: Domain, name: str) -> Domain:
        taken.append((domain, name))
        if len(taken) != 1:
            raise CaseError("other elements")
        return domain

    monkeypatch.setattr(calibration, "same_mesh", other)
    monkeypatch.setattr(Domain, "build", staticmethod(domain_of))
    near, far = (runs._run(values_of(runs) * factor)[0].domain for factor in (1.0, 1.5))
    assert near is first
    assert far is not first
    assert far is runs.domain
    with pytest.raises(CaseError, match="other elements"):
        runs._run(values_of(runs) * 1.5, far)
    assert [domain for domain, _ in taken] == [first, first, far]
