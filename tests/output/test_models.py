"""Runs of every model, stored by hand: what a run does not have is left out of its report, exports and summary."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import meshio
import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.channel import Beam
from ngfsi_geometry.lofted import LoftedMesh, LoftedVein
from numpy.typing import NDArray
from rich.console import Console

from ngfsi.analysis.transmission import Surroundings, transmission
from ngfsi.analysis.tube import tube_laws
from ngfsi.case import Case, Cuff, Loads, Materials, TimeStepping
from ngfsi.config.functions import PressureConstant, PressureTable
from ngfsi.errors import OutputError
from ngfsi.materials import load_set
from ngfsi.mesh.domain import Domain
from ngfsi.outlines.outline import Outline
from ngfsi.report import charts, render
from ngfsi.report.html import report
from ngfsi.report.shapes import unroll
from ngfsi.report.terminal import run_summary
from ngfsi.store import RunFolder, open_run
from ngfsi.store.export import export
from ngfsi.store.fields import DEFORMATION, STRESS, FieldWriter
from ngfsi.store.folder import outline_rows
from ngfsi.store.stored import StoredRun
from ngfsi.store.vessels import Course
from ngfsi.units import Shown
from tests.output.fake import CASE, GEOMETRY, _rings, domain, fake_run, wall_sample

Array = NDArray[np.float64]
TURN = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Takes z to x, x to y and y to z."""
TIMES = (0.0, 0.5, 1.0)
REST = PressureConstant(value=0.0)


def store(
    path: Path,
    case: Case,
    body: Domain,
    columns: dict[str, list[float]],
    vessels: dict[str, Any],
    fields: dict[str, Any],
) -> StoredRun:
    folder = RunFolder.create(path, case)
    folder.update_manifest(vessels=vessels, mesh=body.statistics())
    writer = FieldWriter(path, body, fields)
    for row, time in enumerate(TIMES):
        folder.append("series", {"time_s": time, **{name: values[row] for name, values in columns.items()}})
        writer.write(time)
    folder.finish("completed")
    return open_run(path)


def entry(line: Array, **more: Any) -> dict[str, Any]:
    names = {"lumen": "fluid", "interface": "interface", "wall": "wall", "outer": "wall_outer"}
    openings = {"inlets": ["inlet"], "outlets": ["outlet"]}
    return {**names, **openings, "radius_m": GEOMETRY.lumen_radius, "centreline_m": line.tolist(), **more}


def said(path: Path, *runs: StoredRun) -> tuple[list[str], str]:
    """Return the headings and the text of a report."""
    text = report([run.path for run in runs], path / "report.html").read_text(encoding="utf-8")
    text = re.sub(r"<script.*?</script>|<style.*?</style>", "", text, flags=re.S)
    assert "Not shown" not in text
    return re.findall(r"<h2>(.*?)</h2>", text), text


def summary(run: StoredRun) -> str:
    console = Console(width=160)
    with console.capture() as captured:
        console.print(run_summary(run))
    return captured.get()


def test_a_rigid_lumen(tmp_path: Path) -> None:
    geometry = LoftedVein(
        outlines=(Outline.circle(0.0, 0.0, 5e-3),) * 4, heights=(0.0, 5e-3, 10e-3, 15e-3), mesh=LoftedMesh()
    )
    loads = Loads(skin_pressure=REST, outlet_pressure=REST)
    case = Case(name="rigid", geometry=geometry, materials=Materials(fluid=load_set("blood")), loads=loads,
                time=TimeStepping(step=0.5, end=1.0))  # fmt: skip
    columns = {"sawss_Pa": [1.0, 1.5, 2.0], "flow_in_m3_s": [0.0] * 3, "mass_defect_m3_s": [0.0] * 3}
    still = {"displacement_m": ng.CF((0, 0, 0)), "pressure_Pa": ng.CF(10.0)}
    vessel = entry(np.array([[0, 0, 0], [0, 0, 15e-3]]), wall=None, outer=None)
    run = store(tmp_path / "run", case, Domain.build(geometry), columns, {"": vessel}, still)
    headings, text = said(tmp_path, run)
    assert headings == ["Result", "Setup", "Costs", "Sources"]  # SAWSS alone makes no chart against developed flow
    assert re.findall(r"<th>(.*?)</th>", text)[:5] == [
        "run", "time s", "SAWSS Pa", "SAWSS / t = 0", "mass defect / inflow"
    ]  # fmt: skip
    assert "<b>2.00</b>" in text
    assert "rigid wall" in summary(run)
    for refused in (lambda: tube_laws(run), lambda: Surroundings.of(run, 0.0), lambda: transmission(run)):
        with pytest.raises(OutputError, match=r"rigid wall|no tissue"):
            refused()
    assert meshio.read(export(run, 1.0, "vtu")[0]).point_data["pressure_Pa"] == pytest.approx(10.0)


def test_solids_alone(tmp_path: Path) -> None:
    """Cut across z at mid-length, since no vessel says where to."""
    fields = {"displacement_m": ng.CF((0, 0, 1e-3)), "hydrostatic_pressure_Pa": ng.CF(2e3)}
    columns = {"skin_pressure_Pa": [0.0, 10.0, 0.0], "displacement_max_m": [0.0, 2e-3, 0.0]}
    run = store(tmp_path / "run", CASE, domain(), columns, {}, fields)
    headings, text = said(tmp_path, run)
    shown = ["Largest displacement", "Hydrostatic pressure of the solids", "Solids in 3-D: fake"]
    assert headings == ["Result", "Setup", *shown, "Costs", "Sources"]
    assert "<td>0.5</td>" in text  # the load ends at 0: its largest counts
    with pytest.raises(OutputError, match="of no vessel"):
        tube_laws(run)


def test_a_plane_section(tmp_path: Path) -> None:
    geometry = Beam()
    law = load_set("mooney_rivlin_s1")
    case = Case(name="plane", geometry=geometry, materials=Materials(solid=law), loads=Loads(skin_pressure=REST),
                time=TimeStepping(step=0.5, end=1.0))  # fmt: skip
    unit = ng.CF((1, 0, 0, 0, 1, 0, 0, 0, 1), dims=(3, 3))
    fields = {"displacement_m": ng.CF((0.1 * ng.x, 0)), STRESS: -2e3 * unit, DEFORMATION: unit}
    columns = {"skin_pressure_Pa": [0.0, 1.0, 2.0], "lumen_area_m2": [2.0, 1.5, 1.0], "skin_area_m2": [4.0, 4.0, 3.0]}
    vessel = {"lumen": None, "interface": "lumen", "wall": "solid", "outer": None, "radius_m": 0.01}
    run = store(tmp_path / "run", case, Domain.build(geometry), columns, {"": vessel}, fields)
    headings, text = said(tmp_path, run)
    shown = ["Area of the lumen in the section", "Area inside the skin", "Hydrostatic pressure of the solids"]
    assert headings == ["Result", "Setup", *shown, "Costs", "Sources"]
    assert ("<b>50.0</b>" in text, "<b>25.0</b>" in text) == (True, True)
    grid = run.fields(1.0)
    assert grid.point_data["displacement_m"].shape[1] == 3
    assert grid["hydrostatic_pressure_Pa"] == pytest.approx(2e3)
    corners = grid.points[grid.cell_connectivity[grid.cell_offsets[:-1, None] + np.arange(3)]]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0).all()
    assert grid.compute_cell_sizes()["Area"].sum() == pytest.approx(1.1 * geometry.exact_volumes()["solid"], rel=1e-3)
    for fmt in ("xdmf", "vtu", "gmsh", "abaqus"):
        mesh = meshio.read(export(run, 1.0, fmt)[0])
        assert mesh.cells[0].type == ("triangle" if fmt == "abaqus" else "triangle6")
        assert fmt != "gmsh" or tuple(mesh.field_data["solid"]) == (1, 2)


def test_stability_of_a_plane_section(tmp_path: Path) -> None:
    geometry, law = Beam(), load_set("mooney_rivlin_s1")
    case = Case(name="plane", geometry=geometry, materials=Materials(solid=law), loads=Loads(),
                time=TimeStepping(step=0.5, end=1.0))  # fmt: skip
    fields = {"displacement_m": ng.CF((0.1 * ng.x, 0)), "hydrostatic_pressure_Pa": ng.CF(2e3)}
    run = store(tmp_path / "run", case, Domain.build(geometry), {}, {}, fields)
    table = "time_s,softest_stiffness_1,softest_x_m,softest_y_m\n0.0,0.25,0.0,0.0\n1.0,0.125,0.0,0.0\n"
    (run.path / "stability.csv").write_text(table, encoding="utf-8")
    run = open_run(run.path)
    headings, _ = said(tmp_path, run)
    assert "Stiffness of the softest motion" in headings
    (line,) = charts.softest({"plane": run}).data
    assert (list(line.x), list(line.y)) == ([0.0, 1.0], [0.25, 0.125])


LOADS: dict[str, tuple[dict[str, list[float]], tuple[float, float]]] = {
    "ends at 0": ({"skin_pressure_mean_Pa": [0.0, 900.0, 900.0, 0.0]}, (0.5, 1.0)),
    "suction": ({"skin_pressure_mean_Pa": [0.0, -900.0, -300.0, 200.0]}, (0.5, 0.5)),
    "held": ({"skin_pressure_mean_Pa": [0.0, 900.0, 900.0, 900.0]}, (0.5, 1.5)),
    "even": ({"skin_pressure_mean_Pa": [900.0] * 4}, (1.5, 1.5)),
    "cuffs": ({"skin_pressure_Pa": [0.0, 1.0, 2.0, 3.0], "skin_pressure_mean_Pa": [0.0, 9.0, 5.0, 3.0]}, (0.5, 0.5)),
    "none": ({"displacement_max_m": [0.0, 2e-3, 1e-3, 0.0]}, (1.5, 1.5)),
}
"""Columns at 0, 0.5, 1 and 1.5 s, and the first and the last time of the largest load."""


@pytest.mark.parametrize("name", LOADS)
def test_largest_load(stored: StoredRun, name: str) -> None:
    """It is not taken to be that at the last time, nor at the last kink of a load."""
    columns, (first, last) = LOADS[name]
    run = replace(stored)
    run.__dict__["series"] = {"time_s": np.array([0.0, 0.5, 1.0, 1.5])} | {k: np.array(v) for k, v in columns.items()}
    assert (run.series["time_s"][run.loaded_row], run.loaded_time) == (first, last)


def test_charts_show_the_largest_load(stored: StoredRun) -> None:
    """Of the fake, whose lumen is narrowest from 1 s on, under a load that ends at 0: the lines and shapes at 0.5 s."""
    run = replace(stored)
    times = stored.series["time_s"]
    run.__dict__["series"] = {**stored.series, "skin_pressure_mean_Pa": np.where(times == 0.5, 900.0, 0.0)}
    half = int(np.argmax(times == 0.5))
    first, loaded = charts.along_vein({"fake": run}, "area", Shown("area", "mm2")).data
    assert loaded.name == "fake, t = 0.5 s"
    assert loaded.y == pytest.approx(1e6 * stored.series["area_z00_m2"][half])
    assert first.y == pytest.approx(1e6 * stored.series["area_z00_m2"][0])
    assert charts.outlines({"fake": run}).data[1].name == "t = 0.5 s"
    shear = np.nanmean(unroll(run)[2])
    assert shear == pytest.approx(
        np.nanmean(np.linalg.norm(run.fields(0.5, "wall")["wall_shear_Pa"], axis=1)), rel=1e-2
    )
    assert shear < 0.95 * np.nanmean(unroll(stored)[2])


def two_vessels(path: Path) -> StoredRun:
    """Store the fake's vein with the same one, 0.3 m away and along x, whose SAWSS is twice as large."""
    plain = fake_run(path / "plain")
    folder = RunFolder.create(path / "two", CASE)
    line = np.array([[*GEOMETRY.vein_centre, 0.0], [*GEOMETRY.vein_centre, GEOMETRY.length]])
    folder.update_manifest(vessels={"": entry(line), "vein_2": entry(line @ TURN.T + 0.3)})
    writer = FieldWriter(folder.path, domain(), {"displacement_m": ng.CF((0, 0, 0))})
    own = ("time_s", "step_s", "skin_pressure_Pa")
    for row, time in enumerate(plain.series["time_s"]):
        first = {name: float(column[row]) for name, column in plain.series.items()}
        changed = {"sawss_Pa": 2 * first["sawss_Pa"], "flow_in_m3_s": CASE.loads.inlet_flow(time)}
        second = {f"vein_2_{name}": value for name, value in (first | changed).items() if name not in own}
        folder.append("series", first | second)
        sample, rings = wall_sample(1 - 0.1 * time), _rings(1 - 0.1 * time)
        there = replace(sample, points=sample.points @ TURN.T + 0.3, shear=2 * sample.shear @ TURN.T)
        writer.write_wall(time, sample, there)
        for number, outlines in enumerate((rings, rings @ TURN.T + 0.3)):
            folder.append("outlines", *outline_rows({"time_s": time, "vessel": number}, outlines))
    folder.finish("completed")
    return open_run(folder.path)


def test_two_vessels(tmp_path: Path) -> None:
    run = two_vessels(tmp_path)
    first, second = run.of_vessel(""), run.of_vessel("vein_2")
    np.testing.assert_array_equal(second.series["sawss_Pa"], 2 * first.series["sawss_Pa"])
    np.testing.assert_array_equal(second.series["time_s"], first.series["time_s"])
    assert "skin_pressure_Pa" in second.series
    np.testing.assert_allclose(second.outlines(9.0)[1], first.outlines(9.0)[1] @ TURN.T + 0.3, rtol=1e-12)
    # angles count from y there, which is where x was turned to
    _, positions, shear = unroll(second)
    assert second.own_vessel.course.start == "y"
    np.testing.assert_allclose(positions, unroll(first)[1], rtol=1e-5, atol=1e-7)  # stored in single precision
    np.testing.assert_allclose(shear, 2 * unroll(first)[2], rtol=1e-3)
    assert run.fields(0.0, "wall").n_cells == 2 * second.fields(0.0, "wall").n_cells
    headings, text = said(tmp_path, run)
    assert {"Area of the lumen", "Area of the lumen, vein_2", "Tube law, vein_2", "Flow balance, vein_2"} <= {*headings}
    assert re.search(r"<td>fake, vein_2</td>.*?<td>0\.(\d+)</td>", text)
    assert summary(run)


def test_cuffs(tmp_path: Path) -> None:
    """Where cuffs press the skin's mean pressure counts, and its largest is said."""
    cuff = Cuff(pressure=PressureTable(times=(0.0, 1.0, 1.5), values=(0.0, 4e3, 0.0)), start=0.02, end=0.06)
    case = CASE.replace(**{"loads.skin_pressure": REST, "loads.cuffs": (cuff,), "name": "cuffs"})
    run = fake_run(tmp_path / "run", case)
    table = (run.path / "series.csv").read_text(encoding="utf-8").splitlines()
    mean = [cuff.pressure(float(line.partition(",")[0])) / 3 for line in table[1:]]
    rows = [f"{line},{value!r},{3 * value!r}" for line, value in zip(table[1:], mean, strict=True)]
    head = f"{table[0]},skin_pressure_mean_Pa,skin_pressure_max_Pa"
    (run.path / "series.csv").write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    run = open_run(run.path)
    assert run.series["time_s"][run.loaded_row] == 1.0
    headings, text = said(tmp_path, run)
    assert "<td>10, most 30</td>" in text
    # the fake's transmural pressure does not change with the cuffs: no law, and without one no flow in one dimension
    assert not {"Tube law", "In one dimension"} & {*headings}
    assert render._caption(run, 1.0) == "t = 1.00 s, 10.0 mmHg on the skin, most 30.0 mmHg"
    assert transmission(run)[run.loaded_row] == pytest.approx(3000 / (4e3 / 3))


def test_a_curved_course() -> None:
    """Around a quarter of a torus: angle and position of its points are those from which they were made."""
    radius, small = 0.1, 0.01
    turned = np.linspace(0, np.pi / 2, 721)
    course = Course(radius * np.column_stack([np.cos(turned), np.sin(turned), 0 * turned]))
    assert course.start == "z"
    assert course.length == pytest.approx(radius * np.pi / 2, rel=1e-6)
    around, along = (part.ravel() for part in np.meshgrid(np.linspace(-3, 3, 7), np.linspace(0.1, 1.4, 5)))
    # across: z, and along x z, which is outwards
    reach = radius + small * np.sin(around)
    points = np.column_stack([reach * np.cos(along), reach * np.sin(along), small * np.cos(around)])
    angle, position = course.around(points)
    np.testing.assert_allclose(angle, around, atol=1e-3)
    np.testing.assert_allclose(position, radius * along, rtol=1e-3)
