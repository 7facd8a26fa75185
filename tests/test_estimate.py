"""`ngfsi run --error`: what it tells, held against runs of another order and step; and how it goes on when stopped."""

from __future__ import annotations

import csv
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ngfsi_geometry import templates
from ngfsi_geometry.calf_section import SectionSizes
from typer.testing import CliRunner

import ngfsi.run.computation
from ngfsi.case import Case
from ngfsi.cli import app
from ngfsi.config.functions import PressureRamp
from ngfsi.errors import OutputError, SolverError, StoppedError
from ngfsi.linear import backends
from ngfsi.run import run
from ngfsi.run.computation import fitting_backend
from ngfsi.run.estimate import companions, estimate
from ngfsi.run.finer import Finer
from ngfsi.run.interrupts import Stops
from ngfsi.store import StoredRun, open_run
from tests.output.fake import CASE as FAKE
from tests.output.fake import fake_run
from tests.vein import TUBE, case_of, system_of

CASE = case_of(TUBE, **{
    "loads.skin_pressure": PressureRamp(final=300.0, duration=0.4), "time.step": 0.1, "time.end": 0.4,
    "conditions.ends": "clamped", "output.fields_every": 0,
})  # fmt: skip


def called(*arguments: str) -> Any:
    return CliRunner().invoke(app, [*arguments, "--error", "--quiet"])


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A run with its errors, and what was printed."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "vein.toml").write_text(CASE.to_toml())
    result = called("run", str(folder / "vein.toml"), "-o", str(folder / "found"))
    assert result.exit_code == 0, result.output
    return folder / "found", result.output


def test_companions() -> None:
    """One order less, or one more from the lowest; steps of double size, if there are two."""
    case = case_of(**{"discretisation.order": 3, "time.step": 0.1, "time.end": 0.4})
    found = companions(case)
    assert (found["space"].discretisation.order, found["space"].time.step) == (2, 0.1)
    assert (found["time"].discretisation.order, found["time"].time.step) == (3, 0.2)
    lowest = companions(case.replace(**{"discretisation.order": 2, "time.end": 0.3}))
    assert list(lowest) == ["space"]
    assert lowest["space"].discretisation.order == 3
    free = case.replace(**{"time.scheme": "esdirk3", "time.error_tolerance": 1e-2})
    assert companions(free)["time"].time.error_tolerance == pytest.approx(0.08)
    assert list(companions(case.replace(**{"time.scheme": "static"}))) == ["space"]


def test_a_run_tells_its_errors(whole: tuple[Path, str], tmp_path: Path) -> None:
    """From space twice the difference to a run of one order more, which is not computed; from time, of a scheme of
    second order, that to the companion at the times that both have."""
    folder, said = whole
    with (folder / "errors.csv").open() as file:
        rows = {row["quantity"]: row for row in csv.DictReader(file)}
    assert list(rows) == ["loss of volume", "SAWSS", "largest wall shear stress"]
    assert [row["unit"] for row in rows.values()] == ["1", "Pa", "Pa"]
    assert all(re.search(rf"│ {quantity} ", said) for quantity in rows)
    own, time = (open_run(folder / name).series for name in ("", "companion_time"))
    finer = run(CASE.replace(**{"discretisation.order": 3}), tmp_path / "finer", quiet=True).series
    loss, doubled, exact = (1 - one["lumen_volume_m3"] / one["lumen_volume_m3"][0] for one in (own, time, finer))
    told = rows["loss of volume"]
    assert float(told["value"]) == pytest.approx(loss[-1], rel=1e-12)
    differences = np.abs(loss[::2] - doubled) / loss.max()
    assert float(told["time_end_1"]) == pytest.approx(differences[-1], rel=1e-9)
    assert float(told["time_largest_1"]) == pytest.approx(differences.max(), rel=1e-9)
    assert float(told["space_end_1"]) == pytest.approx(2 * abs(exact[-1] - loss[-1]) / loss.max(), rel=1e-3)
    for name, column in (("SAWSS", "sawss_Pa"), ("largest wall shear stress", "wss_max_Pa")):
        change = abs(finer[column][-1] - own[column][-1]) / own[column].mean()
        assert float(rows[name]["space_end_1"]) == pytest.approx(2 * change, rel=5e-2), name
    sawss = np.abs(own["sawss_Pa"][::2] - time["sawss_Pa"]) / own["sawss_Pa"].mean()
    assert float(rows["SAWSS"]["time_largest_1"]) == pytest.approx(sawss.max(), rel=1e-9)


def test_a_plane_section_tells_the_error_of_its_loss_of_area(tmp_path: Path) -> None:
    """Against order 4; and elements of order 3 find the state at 20 mmHg, far from that of their first factors."""
    sizes = SectionSizes(far_size=25e-3, bone_size=14e-3, vein_size=5e-3, curving_order=3)
    (tmp_path / "section.toml").write_text(templates.section())
    changes = {"geometry.mesh": sizes, "time.step": 0.5, "output.fields_every": 0}
    section = Case.from_toml(tmp_path / "section.toml").replace(**changes)
    found, exact = (
        run(section.replace(**{"discretisation.order": order}), tmp_path / f"order_{order}", quiet=True)
        for order in (2, 4)
    )
    (row,) = estimate(found, quiet=True)
    lost, wanted = (1 - one.series["lumen_area_m2"][-1] / one.series["lumen_area_m2"][0] for one in (found, exact))
    assert (row["quantity"], row["value"]) == ("loss of area", pytest.approx(lost, rel=1e-12))
    error = abs(lost - wanted) / lost
    assert error > 1e-3
    assert 0.5 * error < float(row["space_end_1"]) < 3 * error


def test_stopped_and_resumed(whole: tuple[Path, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the run, then in the companion: what is complete stays, the rest goes on, with the same errors."""
    folder = tmp_path / "found"
    (tmp_path / "vein.toml").write_text(CASE.to_toml())
    with monkeypatch.context() as patch:
        asked = iter([None] * 2 + ["stop"] + [None] * (3 + 1) + ["stop"])
        patch.setattr(Stops, "request", lambda _: StoppedError("stopped by the test") if next(asked) else None)
        again = ["resume", str(folder)]
        for command in (["run", str(tmp_path / "vein.toml"), "-o", str(folder)], again):
            error = called(*command).exception
            assert isinstance(error, StoppedError)
            assert re.fullmatch(rf"stopped by the test at t = 0\.2 s, .*: go on with `ngfsi resume {folder} --error`",
                                str(error))  # fmt: skip
            assert not (folder / "errors.csv").exists()
    result = called(*again)
    assert result.exit_code == 0, result.output
    assert result.output == whole[1]
    assert (folder / "errors.csv").read_bytes() == (whole[0] / "errors.csv").read_bytes()
    for name in ("", "companion_time"):
        assert [one["from_s"] for one in open_run(folder / name).manifest["resumed"]] == [0.2], name
    with pytest.raises(OutputError, match="nothing to resume"):
        raise called(*again).exception or AssertionError


def test_what_fails_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its columns are left out; without any error there is no table. The time left is what is left.

    The companion in space, of one order less, is that of a prestressed shape. With a scheme of fourth order the
    difference to steps of double size is divided by 3.
    """
    prestressed = FAKE.replace(**{"conditions.initial_state": "prestress", "time.scheme": "sdirk4"})
    found, limits = fake_run(tmp_path / "run", prestressed), []

    def failing(case: Case, folder: Path, *, max_wall: float, **_: Any) -> StoredRun:
        limits.append(max_wall)
        if folder.name in fail:
            raise SolverError("it diverged")
        return fake_run(folder, case, loss=0.2)

    monkeypatch.setattr(ngfsi.run.computation, "run", failing)
    fail, said = ["companion_space"], []
    rows = estimate(found, max_wall=60.0, say=said.append)
    assert said == ["no error from space: it diverged"]
    assert "space_end_1" not in rows[0]
    assert rows[0]["time_end_1"] == pytest.approx(0.05 / 0.25 / 3, rel=1e-9)
    assert found.errors == [{**row, "unit": 1.0 if row["unit"] == "1" else "Pa"} for row in rows]
    assert 50.0 < limits[1] < limits[0] <= 60.0
    fail.append("companion_time")
    shutil.rmtree(tmp_path / "run" / "companion_time")
    with pytest.raises(OutputError, match="no error from time: it diverged; no error from space: it diverged"):
        estimate(found, max_wall=60.0)
    fail.clear()
    elastic = fake_run(tmp_path / "elastic")
    assert "time_end_1" in estimate(elastic, max_wall=60.0, say=said.append)[0]
    assert re.fullmatch(r"no error from space: '.*end\.npz' cannot be read: No such file or directory", said[-1])
    lower = estimate(fake_run(tmp_path / "again", prestressed), max_wall=60.0)
    assert lower[0]["space_largest_1"] == pytest.approx(0.05 / 0.25, rel=1e-9)


def test_what_is_too_large_for_factors_is_not_factorised(monkeypatch: pytest.MonkeyPatch) -> None:
    """Elements of one order more have a solver that fits their own number."""
    system = system_of(CASE)
    monkeypatch.setattr(backends, "CROSSING", {2: 10 * system.unknowns.size, 3: 2 * system.unknowns.size})
    assert fitting_backend(system)[0] != "p_multigrid"
    monkeypatch.setattr(backends, "CROSSING_OF_TETRAHEDRA", 1)
    assert fitting_backend(system)[0] != "p_multigrid"
    assert fitting_backend(system_of(CASE.replace(**{"geometry.mesh.element": "tetrahedron"})))[0] == "p_multigrid"
    assert Finer(system)._newton.factorisation.backend == "p_multigrid"
