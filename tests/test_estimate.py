"""`ngfsi run --error`: what the two companions tell, held against runs that are made here."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from ngfsi.cli import app
from ngfsi.config.functions import PressureRamp
from ngfsi.run.estimate import companions
from ngfsi.store import open_run
from tests.vein import TUBE, case_of


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


def test_a_run_tells_its_errors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As differences to the companions at the times that both have."""
    monkeypatch.chdir(tmp_path)
    changes = {"loads.skin_pressure": PressureRamp(final=300.0, duration=0.4), "time.step": 0.1, "time.end": 0.4}
    case = case_of(TUBE, **changes, **{"conditions.ends": "clamped", "output.fields_every": 0})
    (tmp_path / "vein.toml").write_text(case.to_toml())
    result = CliRunner().invoke(app, ["run", "vein.toml", "--error", "--quiet", "-o", "found"])
    assert result.exit_code == 0, result.output
    assert "Estimated error of the loss of volume at the end:" in result.output
    with Path("found/errors.csv").open() as file:
        rows = {row["quantity"]: row for row in csv.DictReader(file)}
    assert list(rows) == ["loss of volume", "SAWSS", "largest wall shear stress"]
    own, space, time = (open_run(Path("found") / name).series for name in ("", "companion_space", "companion_time"))
    loss = [1 - one["lumen_volume_m3"] / one["lumen_volume_m3"][0] for one in (own, space, time)]
    assert float(rows["loss of volume"]["value"]) == pytest.approx(loss[0][-1], rel=1e-12)
    for name, other, every in (("space", loss[1], 1), ("time", loss[2], 2)):
        differences = np.abs(loss[0][::every] - other) / loss[0].max()
        assert float(rows["loss of volume"][f"{name}_end_1"]) == pytest.approx(differences[-1], rel=1e-9)
        assert float(rows["loss of volume"][f"{name}_largest_1"]) == pytest.approx(differences.max(), rel=1e-9)
    sawss = np.abs(own["sawss_Pa"][::2] - time["sawss_Pa"]) / own["sawss_Pa"].mean()
    assert float(rows["SAWSS"]["time_largest_1"]) == pytest.approx(sawss.max(), rel=1e-9)
