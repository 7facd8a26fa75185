"""Studies: many cases, what is reused and what is repeated, failures, and the report on the tissues."""

from __future__ import annotations

import csv
import dataclasses
import signal
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from pathlib import Path
from threading import Lock
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
import pyvista
from ngfsi_geometry.segment import MeshSettings
from ngfsi_studies import compare_tissues, tissue_accuracy, tissue_figures, tissue_findings, tissue_report
from ngfsi_studies.tissue_findings import find

from ngfsi import cli, process
from ngfsi.case import Case
from ngfsi.errors import CaseError, NgfsiError, StoppedError
from ngfsi.report.tables import markdown_table
from ngfsi.run import run as compute
from ngfsi.store import RunFolder, open_run
from ngfsi.study import Outcome, Study, run_cases, run_study
from ngfsi.study import engine as study
from tests.output.fake import CASE, INFLATION, fake_run
from tests.test_resume import CASE as RESUMED

SOFTER = CASE.replace(**{"materials.tissue.K": 20e3})


@pytest.fixture
def computed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The runs that were computed, by a fake in place of the child process; a case named 'bad' fails."""
    done: list[str] = []
    lock = Lock()

    def compute(text: str, folder: Path, *_: Any) -> tuple[int, str]:
        case = Case.from_dict(tomllib.loads(text))
        done.append(folder.name)
        if case.name == "dead":
            return -signal.SIGSEGV, ""
        if case.name == "unmeshable":
            return 2, "a warning\nno mesh could be made"
        with lock:  # NGSolve is not made for two threads of Python
            fake_run(folder, case, status="failed" if case.name == "bad" else "completed")
        return (3, "long story") if case.name == "bad" else (0, "")

    monkeypatch.setattr(study, "_compute", compute)
    return done


def test_finished_runs_are_reused(tmp_path: Path, computed: list[str]) -> None:
    first = run_cases({"m": CASE, "n": SOFTER}, tmp_path, quiet=True)
    assert sorted(computed) == ["m", "n"]
    assert [outcome.reused for outcome in first.values()] == [False, False]
    again = run_cases({"n": SOFTER.replace(name="renamed"), "m": CASE}, tmp_path, quiet=True)
    assert len(computed) == 2
    assert list(again) == ["n", "m"]
    assert [outcome.reused for outcome in again.values()] == [True, True]
    assert again["m"].run is not None
    assert again["m"].run.case == CASE


def test_another_case_is_moved_aside_and_an_unfinished_one_repeated(tmp_path: Path, computed: list[str]) -> None:
    run_cases({"m": CASE}, tmp_path, quiet=True)
    run_cases({"m": SOFTER}, tmp_path, quiet=True)
    (aside,) = tmp_path.glob("m.until-*")
    assert open_run(aside).case == CASE
    assert open_run(tmp_path / "m").case == SOFTER
    RunFolder.create(tmp_path / "n", CASE).finish("interrupted", "by the user")
    assert run_cases({"n": CASE}, tmp_path, quiet=True)["n"].failure == ""
    assert open_run(tmp_path / "n").status == "completed"
    assert computed == ["m", "m", "n"]
    assert len(list(tmp_path.glob("n*"))) == 1


def test_another_version_is_not_reused(tmp_path: Path, computed: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    run_cases({"m": CASE}, tmp_path, quiet=True)
    monkeypatch.setattr("ngfsi.__version__", "99")
    run_cases({"m": CASE}, tmp_path, quiet=True)
    assert computed == ["m", "m"]


def test_failures_are_told_and_stop_nothing(tmp_path: Path, computed: list[str]) -> None:
    names = ("bad", "dead", "unmeshable", "good")
    outcomes = run_cases({name: CASE.replace(name=name) for name in names}, tmp_path, quiet=True)
    assert sorted(computed) == sorted(names)
    assert {name: outcome.failure for name, outcome in outcomes.items()} == {
        "bad": "the step at 1.5 s did not converge",
        "dead": "its process was ended by signal 11",
        "unmeshable": "no mesh could be made",
        "good": "",
    }
    assert outcomes["bad"].run is not None
    assert outcomes["dead"].run is None


def study_of(**cases: Case) -> Study:
    return Study(
        "some", cases, {"last_s": lambda run: run.series["time_s"][-1]}, {key: {"a_mm": 1 / 3} for key in cases}
    )


def test_a_study_runs_each_content_once_and_lists_failures(tmp_path: Path, computed: list[str]) -> None:
    """Finished cases are never run again, whatever their key; failed ones on request; one table, one report."""
    bad = CASE.replace(**{"name": "bad", "time.end": 0.5})
    first = run_study(study_of(m=CASE, twin=CASE, bad=bad), tmp_path, quiet=True)
    assert sorted(computed) == sorted({CASE.digest[:16], bad.digest[:16]})
    assert first.table == {"m": {"last_s": 1.5}, "twin": {"last_s": 1.5}}
    again = run_study(study_of(other=CASE, bad=bad), tmp_path, quiet=True)
    assert len(computed) == 2
    assert again.outcomes["bad"].failure == "the step at 1.5 s did not converge"
    lines = (tmp_path / "some.csv").read_text(encoding="utf-8").splitlines()
    assert lines == [
        "case,a_mm,last_s,run", f"other,{1 / 3!r},1.5,{CASE.digest[:16]}", f"bad,{1 / 3!r},,{bad.digest[:16]}"
    ]  # fmt: skip
    page = again.report.read_text(encoding="utf-8")
    assert "# some: 1 of 2 cases" in page
    assert "1 failed, and are computed again on request (`--retry-failed`):" in page
    assert f"- bad (runs/{bad.digest[:16]}): the step at 1.5 s did not converge" in page
    assert "2 runs took 13 s, 6 s the longest; 2 were there." in page
    assert "![results](some.png)" in page
    assert (tmp_path / "some.png").exists()
    assert pyarrow.parquet.read_table(tmp_path / "some.parquet").to_pydict()["last_s"] == [1.5, None]
    run_study(study_of(bad=bad), tmp_path, retry_failed=True, quiet=True)
    assert computed[2:] == [bad.digest[:16]]


def test_the_command_retries_what_failed_on_request(
    tmp_path: Path, computed: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a study of named runs, and of one with runs by their hash, which lie one folder deeper."""
    cases = {"m": CASE, "bad": CASE.replace(name="bad")}

    def both(_level: str, folder: Path, quiet: bool) -> Path:
        run_cases(cases, folder, quiet=quiet)
        return run_study(study_of(bad=cases["bad"]), folder, quiet=quiet).report

    monkeypatch.setattr(compare_tissues, "study", both)
    for more, wanted in (([], 3), ([], 3), (["--retry-failed"], 5)):
        with pytest.raises(SystemExit) as ended:
            cli.main(["study", "compare_tissues", "--output", str(tmp_path), "--quiet", *more])
        assert ended.value.code == 0
        assert len(computed) == wanted
    assert computed[3:] == ["bad", cases["bad"].digest[:16]]
    assert capsys.readouterr().err.count("failed and is computed again") == 2


def test_a_study_without_cases_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match="the study 'some' has no cases"):
        run_study(study_of(), tmp_path, quiet=True)


def test_a_study_with_an_executor_goes_on_where_it_was_killed(tmp_path: Path) -> None:
    """Real runs in the workers of a process pool: one begun before goes on from its checkpoint, the other is new."""
    begun = RESUMED.replace(**{"time.end": 0.1})
    new = begun.replace(**{"time.end": 0.05})
    folder = tmp_path / "runs" / begun.digest[:16]
    with pytest.raises(StoppedError):
        compute(begun, folder, quiet=True, max_wall=0.01)
    with ProcessPoolExecutor(1) as pool:
        results = run_study(study_of(begun=begun, new=new), tmp_path, pool, quiet=True)
    assert [outcome.failure for outcome in results.outcomes.values()] == ["", ""]
    assert results.table == {"begun": {"last_s": 0.1}, "new": {"last_s": 0.05}}
    assert [entry["from_s"] for entry in open_run(folder).manifest["resumed"]] == [0.0]


def test_a_study_on_executorlib(tmp_path: Path) -> None:
    """A real run in a worker that executorlib starts here, as it would on a node of a cluster."""
    library = pytest.importorskip("executorlib")
    with library.SingleNodeExecutor(max_workers=1, hostname_localhost=True) as executor:
        short = RESUMED.replace(**{"time.end": 0.05})
        results = run_study(study_of(short=short), tmp_path, executor, quiet=True)
    assert (results.outcomes["short"].failure, results.table) == ("", {"short": {"last_s": 0.05}})


class Broken(Executor):
    """Its only worker dies."""

    def submit(self, *_: Any, **__: Any) -> Future[Any]:  # type: ignore[override]
        future: Future[Any] = Future()
        future.set_exception(BrokenExecutor("the node is gone"))
        return future


def test_an_executor_that_fails_is_told(tmp_path: Path) -> None:
    outcome = run_study(study_of(m=CASE), tmp_path, Broken(), quiet=True).outcomes["m"]
    assert outcome.failure == "BrokenExecutor: the node is gone"


def test_interrupted_children_are_asked_twice_then_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first signal may wait for the end of a step, the second is heard at once; what ignores both is killed."""
    monkeypatch.setattr(study, "PATIENCE", (1.0, 1.0))
    code = "import signal, time; signal.signal(2, {}); print(flush=True); [time.sleep(0.1) for _ in range(600)]"
    children = [
        subprocess.Popen([sys.executable, "-c", code.format(heard)], stdout=subprocess.PIPE, text=True,
                         start_new_session=True, cwd=tmp_path)
        for heard in ("lambda *_: signal.signal(2, signal.SIG_DFL)", "signal.SIG_IGN")
    ]  # fmt: skip
    for child in children:
        assert child.stdout is not None
        child.stdout.readline()
    study._interrupt(children)
    assert [child.wait(5) for child in children] == [-signal.SIGINT, -signal.SIGKILL]


def test_the_child_process_says_why_it_failed(tmp_path: Path) -> None:
    (tmp_path / "case.toml").write_text("name = 3")
    child = process.call("ngfsi.study.engine:main", tmp_path / "case.toml", tmp_path / "run")
    assert child.returncode == 2
    assert "case.toml: " in child.stderr.splitlines()[-1]


def test_markdown_table() -> None:
    assert markdown_table(("a", "b"), [("x|y", "1")]) == "| a | b |\n| --- | ---: |\n| x\\|y | 1 |\n"
    with pytest.raises(ValueError, match="a row of 3 cells below a head of 2"):
        markdown_table(("a", "b"), [("1", "2"), ("1", "2", "3")])


def test_findings(tmp_path: Path) -> None:
    finding = find("M", Outcome(fake_run(tmp_path / "m", loss=0.19)))
    assert finding is not None
    now = finding.ramp_end
    assert (now.time, finding.end.time, finding.held) == (1.0, 1.5, True)
    assert now.skin_mmhg == pytest.approx(25)
    assert now.loss == pytest.approx(0.19)
    assert finding.inflation == pytest.approx(INFLATION - 1)
    assert now.loss_unloaded == pytest.approx(1 - INFLATION * 0.81)
    # the fake's SAWSS is that of developed flow of constant rate times 1.5 during the ramp, 1.3 of it by flow
    start = now.sawss / now.sawss_ratio
    expected = {"at t = 0": 1.0, "narrowing": 0.9**-3 - 1, "squeeze flow": 0.3 * 0.9**-3, "shape": 0.05 * 0.9**-3,
                "profile": 0.15 * 0.9**-3}  # fmt: skip
    assert now.parts == pytest.approx({cause: start * value for cause, value in expected.items()})
    assert sum(now.parts.values()) == pytest.approx(now.sawss)
    assert now.rise == pytest.approx(100 * (0.9**-3 * 1.5 - 1))
    assert finding.end.rise == pytest.approx(100 * (0.9**-3 - 1))
    assert finding.mean_rise == pytest.approx(100 * (1.5 * (1 - 0.19 * 0.8) ** -1.5 - 1), rel=0.01)
    assert finding.period is None
    assert now.pressures == {"tissue_side": 3000.0, "wall_side": 5000.0, "wall_mean": 4000.0}


def test_oscillations_are_averaged_and_timed() -> None:
    times = np.arange(201) * 0.005
    swing = np.sin(2 * np.pi * times / 0.125)
    run: Any = SimpleNamespace(series={"time_s": times, "sawss_Pa": 1 + times + 0.5 * swing})
    assert tissue_findings.mean_sawss(run, 1.0) == pytest.approx(1.8, rel=2e-3)
    assert tissue_findings._period(times, 3 + swing) == pytest.approx(0.125, rel=1e-9)
    # at unequal distances: their mean
    peaks = np.array([20, 45, 70, 95, 130])
    tents = -np.abs(np.arange(201)[:, None] - peaks).min(axis=1)
    assert tissue_findings._period(times, tents) == pytest.approx(27.5 * 0.005, rel=1e-9)
    assert tissue_findings._period(times[::5], swing[::5]) is None  # five steps a period, which do if each has stages
    assert tissue_findings._period(times[::5], swing[::5], stages=5) == pytest.approx(0.125, rel=1e-9)
    assert tissue_findings._period(times[::12], swing[::12], stages=5) is None
    assert tissue_findings._period(times, times) is None


def test_findings_of_a_run_that_ended_early(tmp_path: Path) -> None:
    run = fake_run(tmp_path / "m", CASE.replace(**{"time.end": 0.5}), status="failed")
    finding = find("M", Outcome(run, "it did not converge"))
    assert finding is not None
    assert (finding.ramp_end.time, finding.held) == (0.5, False)
    assert finding.ramp_end.skin_mmhg == pytest.approx(12.5)
    RunFolder.create(tmp_path / "n", CASE)
    assert find("N", Outcome(open_run(tmp_path / "n"), "no state")) is None
    assert find("N", Outcome(None, "no mesh")) is None


def test_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    accuracy = tmp_path / "accuracy.toml"
    accuracy.write_text("[paper]\nloss_percent = 0.05\nsawss_percent = 1.5\n")
    monkeypatch.setattr(
        compare_tissues, "numerical_errors", lambda level: tissue_findings.numerical_errors(level, accuracy)
    )
    for picture in ("displacement_picture", "wall_shear_picture"):
        monkeypatch.setattr(tissue_figures, picture, lambda *_: "3-D pictures need OpenGL")
    losses = {"m_s1": 0.25, "m_s2": 0.27, "n_likely": 0.15, "n_printed": 0.03}
    outcomes = {key: Outcome(fake_run(tmp_path / key, loss=loss)) for key, loss in losses.items()}
    early = fake_run(tmp_path / "m_tenth", CASE.replace(**{"time.end": 0.5}), loss=0.6, status="failed")
    outcomes |= {"m_tenth": Outcome(early, "it did not converge"), "m_s4": Outcome(None, "no mesh could be made")}
    path = compare_tissues.write_report("paper", tmp_path, outcomes, quiet=True)
    text = path.read_text(encoding="utf-8")
    assert "the vein has lost **25.0 %** of its volume (the source prints 25 %)" in text
    assert "| N: volume reduction, % | N, likely constants | 19 | 15.0 | -4.0 | 0.05 % of the loss | 1 |" in text
    assert "| M: rise of SAWSS, % | M, K 28.45 kPa | 205 | 131 | -74 | 1.5 % of SAWSS | 2 |" in text
    # one definition of the pressure: 4 kPa in the mean over the wall, neither 3 nor 5 on the sides of its face
    assert "| M, K 28.45 kPa | 5.83 | 4.00 | -1.83 | not measured | 3 |" in text
    assert "| N, likely constants | 3.39 | 4.00 | +0.61 | not measured | 3 |" in text
    assert "205 and 145 % are rises by the formula that the source prints" in text
    assert "2.913 ml/s is inferred: the flow of subject 7" in text
    # a quarter of the area at 1333 Pa is lost over 3333 Pa: K is where the line through it meets no area
    stored = {row["run"]: row for row in csv.DictReader((tmp_path / "results.csv").open())}
    assert float(stored["m_s1"]["tube_stiffness_Pa"]) == pytest.approx(3333.05 / 0.25 - 1333.22, rel=1e-6)
    assert "M over the bulk moduli of the 2 subjects: 25.0 to 27.0 %" in text
    assert "shear modulus of 6.98 kPa and cannot have given the printed loss" in text  # the fake's tissue is M
    assert "M / 10 ended early, at 0.5 s and 12.5 mmHg: it did not converge. Smallest det F in its last" in text
    assert "M, K 35.41 kPa has no state at t = 0: no mesh could be made" in text
    assert text.count("*3-D pictures need OpenGL*") == 2
    for picture in ("area", "sawss_11.1mm", "sawss_ratio", "outlines"):
        assert f"({picture}.png)" in text
        assert (tmp_path / f"{picture}.png").stat().st_size > 10_000


def test_the_pattern_of_a_run() -> None:
    """Of the tissue alone, at its places without load; shear over the stations, three of eleven at either end."""
    rest = 1e-3 * np.array([[0, -50, 60], [-0.5, 17, 60], [50, 0, 60], [8, -6, 60]])
    moved = 1e-3 * np.array([[4, 0, 3], [0, 0, -0.5], [-1, 0, 0], [9, 9, 9]])
    grid = pyvista.UnstructuredGrid(
        np.array([1, 0, 1, 1, 1, 2, 1, 3]), np.full(4, pyvista.CellType.VERTEX), rest + moved
    )
    grid.point_data["displacement_m"] = moved
    grid.cell_data["region"] = [1, 1, 1, 0]
    grid.field_data["regions"] = ["fluid", "tissue"]
    shear = np.array([np.ones(11), [2, 3, 4, 6, 6, 6, 6, 6, 8, 9, 10]])
    times = np.array([0.0, 1.0])
    shape = {"time_s": np.repeat(times, 2), "circularity_1": np.array([0.5, 0.5, 0.97, 0.98])}
    run: Any = SimpleNamespace(
        fields=lambda time: {1.0: grid}[time], case=CASE, series={"time_s": times}, shape=shape,
        along=lambda *_: shear,
    )  # fmt: skip
    found = tissue_findings.pattern(run, 1.0)
    assert found.displacement_m == pytest.approx(5e-3)
    assert np.degrees(found.direction_rad) == pytest.approx(-90)
    assert found.between_bones_1 == pytest.approx(0.1)
    assert (found.shear_distal_1, found.shear_proximal_1) == pytest.approx((0.5, 1.5))
    assert found.shear_variation_1 == pytest.approx(np.sqrt(58 / 11) / 6)
    assert found.circularity_1 == 0.97
    row = {"title": "M", **dataclasses.asdict(found)}
    assert "| M | 5.00 | -90° | 0.10 | 0.50 | 1.50 | 0.38 | 0.970 |" in tissue_report.pattern_table([row])


def test_a_report_without_any_result(tmp_path: Path) -> None:
    outcomes = {key: Outcome(None, "no mesh could be made") for key in compare_tissues.MAIN}
    text = compare_tissues.write_report("demo", tmp_path, outcomes, quiet=True).read_text(encoding="utf-8")
    assert "**M** has no result" in text
    assert "N, likely constants has no state at t = 0: no mesh could be made" in text


def test_accuracy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Errors are distances from the finest run plus Richardson's bar of that; those of space and time are added."""
    losses = {
        "demo_mesh": 0.2, "paper_mesh": 0.24, "fine_mesh": 0.25, "order_more": 0.25,
        "double_step": 0.21, "paper_step": 0.22, "half_step": 0.225,
    }  # fmt: skip
    unknowns = {"paper_mesh": 1000, "fine_mesh": 8000}

    def all_computed(cases: Mapping[str, Case], folder: Path) -> dict[str, Outcome]:
        assert {key: case.time.step for key, case in cases.items()} == {
            "demo_mesh": 0.05, "paper_mesh": 0.05, "fine_mesh": 0.05, "order_more": 0.05,
            "double_step": 0.05, "paper_step": 0.025, "half_step": 0.0125,
        }  # fmt: skip
        assert [case.time.scheme for case in cases.values()] == 4 * ["bdf2"] + 3 * ["sdirk4"]
        meshes = {key: case.geometry.mesh for key, case in cases.items()}
        assert meshes["paper_mesh"] != meshes["demo_mesh"] == meshes["half_step"] == meshes["paper_step"]
        assert cases["order_more"].discretisation.order == meshes["order_more"].curving_order == 4
        runs = {key: fake_run(folder / key, loss=losses[key]) for key in cases}
        for key, run in runs.items():
            run.manifest["unknowns"] = unknowns.get(key, 500)
        return {key: Outcome(run) for key, run in runs.items()}

    monkeypatch.setattr(tissue_accuracy, "run_cases", all_computed)
    target, page = tmp_path / "accuracy.toml", tmp_path / "accuracy.md"
    errors = tissue_accuracy.measure(tmp_path, target, page)
    # twice as fine and of second order: a third of the last change; steps: changes of 0.01 and 0.005 are of order 1
    space, time = (0.05 + 0.01 / 3) / 0.75, (0.025 + 0.005) / 0.775
    assert errors["demo"]["volume_percent"] == pytest.approx(100 * (space + time), rel=0.05)  # two digits are kept
    shears = [(1 - loss) ** -1.5 for loss in (0.2, 0.24, 0.25)]
    bar = abs(shears[2] - shears[1]) / 3
    wanted = 100 * (abs(shears[2] - shears[0]) + bar) / shears[2]
    assert errors["demo"]["sawss_space_percent"] == pytest.approx(wanted, rel=0.05)
    assert errors["paper"]["volume_time_percent"] == pytest.approx(100 * (0.005 + 0.005) / 0.775, rel=0.05)
    assert tissue_findings.numerical_errors("demo", target) == errors["demo"]
    assert tissue_findings.numerical_errors("other", target) == {}
    text = page.read_text(encoding="utf-8")
    assert "| fine mesh | 2 | 8,000 |" in text
    assert "| error bar of fine mesh, space |  |  |  |  | 0.44 % | 1.3 % |" in text  # of volume and of loss
    monkeypatch.setattr(tissue_accuracy, "run_cases", lambda *_: {"demo_mesh": Outcome(None, "no mesh")})
    with pytest.raises(NgfsiError, match=r"'demo_mesh' in .* failed: no mesh"):
        tissue_accuracy.measure(tmp_path, target, page)


def test_levels_hold_what_they_promise() -> None:
    for level in compare_tissues.LEVELS.values():
        for key in level.variants:
            case = compare_tissues.case(key, level)
            assert case.geometry.lumen_diameter == (8e-3 if key.endswith("8mm") else 11.1e-3)
            assert case.materials.tissue.label == compare_tissues.VARIANTS[key].tissue
            assert case.time.step * case.output.fields_every == pytest.approx(0.25)
    assert compare_tissues.case("m_s1", compare_tissues.LEVELS["paper"]).time.scheme == "sdirk4"
    assert set(compare_tissues.LEVELS["paper"].variants) == set(compare_tissues.VARIANTS)


def test_a_tiny_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The real thing, coarse and to half of the pressure: both tissues computed, M the softer one, its figures."""
    for picture in ("displacement_picture", "wall_shear_picture"):  # tests/output/test_render.py draws them
        monkeypatch.setattr(tissue_figures, picture, lambda *_: "3-D pictures need OpenGL")
    mesh = MeshSettings(axial_layers=2, vein_size=8e-3, far_size=25e-3, lumen_radii=(0.6,), curving_order=2)
    tiny = compare_tissues.LEVELS["demo"]._replace(mesh=mesh, order=2, step=0.25, end=0.5)
    monkeypatch.setitem(compare_tissues.LEVELS, "demo", tiny)
    report = compare_tissues.study("demo", tmp_path, quiet=True).read_text(encoding="utf-8")
    m, n = (open_run(tmp_path / key) for key in compare_tissues.MAIN)
    left_m, left_n = (run.series["lumen_volume_m3"][-1] / run.series["lumen_volume_m3"][0] for run in (m, n))
    assert 0.7 < left_m < left_n < 1
    for run in (m, n):
        assert run.status == "completed"
        assert run.series["time_s"].tolist() == [0, 0.25, 0.5]
        defect = np.abs(run.series["mass_defect_m3_s"]).max()
        # the last update makes it smaller than the tolerance
        assert defect < run.case.solver.tolerance * run.series["flow_in_m3_s"][0] / 10
        np.testing.assert_allclose(run.series["flow_in_m3_s"], 2.913e-6, rtol=1e-10)
        assert run.field_times() == [0.0, 0.25, 0.5]
        grid = run.fields(0.5)
        axial = grid.point_data["displacement_m"][:, 2]
        height = grid.points[:, 2] - axial
        ends = (height < 1e-6) | (height > run.case.geometry.length - 1e-6)
        assert np.abs(axial[ends]).max() < 1e-6  # the ends slide in their planes (roller)
    assert "at 12.5 mmHg on the skin" in report
    for picture in ("area.png", "outlines.png"):
        assert (tmp_path / picture).exists()
