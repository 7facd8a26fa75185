"""Sizes that no vessel has are said with the unit that would fit; files of a case lie beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ngfsi_geometry.external import ExternalMesh

from ngfsi.case import Case
from ngfsi.case.plausible import implausible
from ngfsi.config.functions import FlowConstant, FlowHarmonics
from ngfsi.errors import GeometryError
from tests.geometry.test_external import MM, cells_of, raw_mesh, tube
from tests.vein import BONED, case_of


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A tube whose file is in metres."""
    import meshio

    file = tmp_path_factory.mktemp("mesh") / "tube.vtu"
    points, rows = cells_of(tube("mixed", 1))
    raw, numbers = raw_mesh(points / MM, rows, "part")
    meshio.write(file, raw)
    return {"file": str(file), "names": {str(number): name for name, number in numbers.items()}}


def test_the_unit_that_would_fit(mesh: dict[str, Any]) -> None:
    wrong = implausible(case_of(ExternalMesh(**mesh, unit="mm")))
    assert [s.partition(" is ")[0] for s in wrong] == [
        "the radius of the lumen", "the thickness of the wall", "the length", "the Reynolds number",
    ]  # fmt: skip
    assert all(s.endswith('unit = "m" would fit, not "mm"') for s in wrong[:3])
    assert "is 0.00542 mm, where vessels have 0.05 mm to 40 mm" in wrong[0]
    assert implausible(case_of(ExternalMesh(**mesh, unit="m"))) == ()


def test_numbers_of_the_flow() -> None:
    """Reynolds number 2 rho Q / (pi R mu), Womersley number R sqrt(omega rho / mu), at the largest flow."""
    plain = case_of(BONED)
    assert implausible(plain) == ()
    flow = 1e4 * np.pi * BONED.lumen_radius * plain.materials.fluid.viscosity / (2 * plain.materials.fluid.density)
    assert implausible(case_of(BONED, **{"loads.inlet_flow": FlowConstant(value=0.999 * flow)})) == ()
    (sentence,) = implausible(case_of(BONED, **{"loads.inlet_flow": FlowConstant(value=-1.001 * flow)}))
    assert sentence.startswith(
        "the Reynolds number is 1e+04, where vessels have 10000 at most: see the unit of the flow"
    )
    fluid = plain.materials.fluid
    period = 2 * np.pi * fluid.density / fluid.viscosity * (BONED.lumen_radius / 60) ** 2
    for factor, count in ((0.999, 1), (1.001, 0)):
        beat = FlowHarmonics(mean=1e-6, amplitudes=(1e-7,), phases=(0.0,), period=factor * period)
        found = implausible(case_of(BONED, **{"loads.inlet_flow": beat}))
        assert len(found) == count
        assert all(s.startswith("the Womersley number is 60") for s in found)


def test_relative_files_lie_beside_the_case(
    mesh: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = case_of(ExternalMesh(**mesh, unit="m"))
    folder = Path(mesh["file"]).parent
    (folder / "inflow.csv").write_text("time_s,flow_ml_s\n0,1\n0.5,2\n1,1.5\n1.5,1\n")
    text = case.to_toml().replace(mesh["file"], "tube.vtu")
    start = text.index("[loads.inlet_flow]")
    rest = text[text.index("[", start + 1) :]
    text = f'{text[:start]}[loads.inlet_flow]\nkind = "waveform"\nfile = "inflow.csv"\n{rest}'
    file = folder / "case.toml"
    file.write_text(text)
    monkeypatch.chdir(tmp_path)
    read = Case.from_toml(file)
    assert read.geometry == case.geometry
    assert read.loads.inlet_flow.values == pytest.approx((1e-6, 2e-6, 1.5e-6, 1e-6))
    monkeypatch.chdir(folder)
    assert Case.from_toml("case.toml") == read
    (tmp_path / "case.toml").write_text(text)
    with pytest.raises(GeometryError, match=f"the mesh '{tmp_path}/tube.vtu' cannot be read: No such file"):
        Case.from_toml(tmp_path / "case.toml")
