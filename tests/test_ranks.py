"""Runs under mpirun: the results of one process on any number of ranks, whatever ends them.

They need an interpreter with petsc4py, which `make mpi` installs; without one they are left out, with the reason.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import ngsolve as ng
import numpy as np
import pytest

import ngfsi.parallel.ranks
from ngfsi import cli
from ngfsi.case import Case, Cuff
from ngfsi.config.functions import PressureRamp
from ngfsi.errors import CaseError
from ngfsi.linear.backends import choose_backend
from ngfsi.materials.solid.viscosity import SolidViscosity
from ngfsi.measure.deformation import Deformation
from ngfsi.measure.points import Points
from ngfsi.measure.stability import Softness
from ngfsi.parallel.ranks import Ranks
from ngfsi.physics.integrals import rules
from ngfsi.run import run
from ngfsi.run.worker import partition
from ngfsi.store import open_run
from ngfsi.store.fields import GRIDS
from ngfsi.store.folder import TABLES
from ngfsi.store.table import read_table
from ngfsi.system.system import System
from ngfsi.system.unknowns import BLOCKS
from ngfsi.transport.models import Age, Exposure
from tests.columns.models import section
from tests.conditions.test_contact import FLOWING
from tests.conftest import SQUEEZED
from tests.updates import case, updates
from tests.vein import block, domain_of, system_of

ROOT = Path(__file__).parents[1]
CUFF = Cuff(pressure=PressureRamp(final=1500.0, duration=0.2), start=5e-3, end=1.0, edge=4e-3)
CASE = SQUEEZED.replace(
    **{"discretisation.order": 3, "conditions.initial_state": "prestress", "time.end": 0.2, "output.wall_every": 2,
       "loads.cuffs": (CUFF,), "scalars": (Age(), Exposure()),
       "materials.tissue.viscosity": SolidViscosity(moduli=(2e3,), times=(0.1,), kelvin_voigt=50.0)}
)  # fmt: skip
"""A vein beside a bone, half of it in a cuff, on rollers, cubic on a quadratic shape, from inverse design: everything
that has factors; with viscous tissue, whose internal variables each rank has of its own part, and what the blood
carries, which rank 0 takes along."""
FLOW = CASE.loads.inlet_flow(0.0)
RADIUS = SQUEEZED.geometry.lumen_radius
SMALL = {"mass_defect_m3_s": FLOW, "centre_x_m": RADIUS, "centre_y_m": RADIUS, "major_angle_rad": np.pi * RADIUS}
"""Sizes of what columns are small differences of."""
PATIENCE = 600.0
"""Seconds after which a run is taken to hang."""


def lonely(rank: int) -> Ranks:
    """Return a rank that knows its place but has nobody to talk to."""
    ranks = Ranks()
    ranks.rank = rank
    return ranks


@pytest.mark.parametrize("count", [2, 3, 1000])
def test_shares_are_compact_and_equal(count: int) -> None:
    domain = domain_of(SQUEEZED.geometry)
    owners = partition(domain, count)
    for region in domain.regions:
        numbers = [element.nr for element in domain.mesh.Elements(ng.VOL) if element.mat == region]
        sizes = np.bincount(owners[numbers], minlength=count)
        assert sizes.max() - sizes.min() <= 1


def test_shares_sum_up_to_the_system() -> None:
    domain = domain_of(SQUEEZED.geometry)
    owners = partition(domain, 3)
    whole = System(SQUEEZED, domain)
    parts = [System(SQUEEZED, domain, ranks=lonely(r), elements=ng.BitArray(list(owners == r))) for r in range(3)]
    whole.update(0.1)
    whole.values[:] = 1e-4 * np.random.default_rng(4).standard_normal(whole.unknowns.size)
    for part in parts:
        part.restore(whole.snapshot())
    wanted = np.array(whole.apply())
    found = [np.array(part.apply()) for part in parts]
    np.testing.assert_allclose(sum(found), wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
    vector = whole.state.vec
    for system in (whole, *parts):
        system.tangent.AssembleLinearization(vector)
    product = np.array((whole.tangent.mat * vector).Evaluate().FV().NumPy())
    sums = sum(np.array((part.tangent.mat * vector).Evaluate().FV().NumPy()) for part in parts)
    np.testing.assert_allclose(sums, product, rtol=0, atol=1e-12 * np.abs(product).max())
    deformations = [Deformation(system) for system in (whole, *parts)]
    for region in domain.regions:
        smallest, *of_parts = (one.smallest_jacobian(region) for one in deformations)
        assert min(of_parts) == pytest.approx(smallest, rel=1e-12)
        assert len(set(of_parts)) == 3
    sizes = {domain.materials("wall"): domain.volume("wall"), domain.boundaries("skin"): domain.area("skin")}
    for region, size in sizes.items():
        of_parts = [Points.of(part, region, rules(8)).integrals(ng.CF(1))[0] for part in parts]
        assert sum(of_parts) == pytest.approx(size, rel=1e-9)
        assert max(of_parts) < 0.6 * size
    entries = [part.tangent.mat.nze for part in parts]
    assert max(entries) < 0.7 * whole.tangent.mat.nze  # a rank stores no matrix of what is not its own


def test_softest_mode_is_that_of_all_elements() -> None:
    whole = section().system
    half = ng.BitArray(list(partition(whole.domain, 2) == 0))
    part = System(whole.case, whole.domain, ranks=lonely(0), elements=half)
    part.restore(whole.snapshot())
    found, wanted = (Softness(system).refresh() for system in (part, whole))
    assert found.stiffness == pytest.approx(wanted.stiffness, rel=1e-8)
    assert found.place == wanted.place


def test_ranks_without_mpi4py(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "4")
    monkeypatch.setattr(ngfsi.parallel.ranks, "find_spec", lambda name: None if name == "petsc4py" else name)
    with pytest.raises(CaseError, match="4 processes were started, which need petsc4py"):
        ngfsi.parallel.ranks.all_ranks.__wrapped__()


@cache
def interpreter() -> str:
    """Return a Python that can run on several ranks here."""
    if shutil.which("mpirun") is None:
        pytest.skip("no mpirun here: see 'Several processes' in docs/using.md")
    made = ROOT / ".venv-mpi" / "bin" / "python"
    needs = "import petsc4py.PETSc, mpi4py.MPI, ngsolve"
    for python in (made, Path(sys.executable)):
        if python.exists() and subprocess.run([python, "-c", needs], capture_output=True, check=False).returncode == 0:
            return str(python)
    assert not made.exists(), f"{made} was made for these tests and does not work"
    pytest.skip("no Python with petsc4py and mpi4py here: run `make mpi`")


def mpirun(ranks: int, *arguments: str, before: str = "") -> subprocess.CompletedProcess[str]:
    """Run `ngfsi` on some ranks, after some code on each of them, to which `rank` is known."""
    code = (
        "import os, sys, signal\nrank = int(os.environ['OMPI_COMM_WORLD_RANK'])\nsys.argv[0] = 'ngfsi'\n"
        f"{before}\nfrom ngfsi.cli import main\nmain()"
    )
    command = ["mpirun", "--allow-run-as-root", "--oversubscribe", "-np", str(ranks), interpreter(), "-c", code]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    plugin = ["--plugin", str(ROOT / "tests" / "vein.py")] if arguments else []
    return subprocess.run(
        [*command, *arguments, *plugin], env=environment, capture_output=True, text=True, timeout=PATIENCE, check=False
    )


@pytest.fixture(scope="module")
def case_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("case") / "case.toml"
    path.write_text(CASE.to_toml())
    return path


@pytest.fixture(scope="module")
def serial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run(exact(CASE), tmp_path_factory.mktemp("serial") / "run", quiet=True).path


def exact(case: Case) -> Case:
    """Return a case for one process with factors of double precision, as those of several ranks are."""
    return case.replace(**{"solver.linear": choose_backend("auto")})


def assert_same(folder: Path, wanted: Path) -> None:
    """As `assert_agrees`, and so do counts, and the files that were left."""
    assert_agrees(folder, wanted)
    one, other = open_run(folder), open_run(wanted)
    for column in ("iterations", "factorisations"):
        np.testing.assert_array_equal(one.costs[column], other.costs[column])
    assert sorted(path.name for path in folder.iterdir()) == sorted(path.name for path in wanted.iterdir())


def assert_agrees(folder: Path, wanted: Path) -> None:
    """Every column of every table but costs agrees to 1e-8 of its largest value, or of the size of what it is a small
    difference of, and all fields to 1e-6."""
    one, other = open_run(folder), open_run(wanted)
    assert one.status == "completed"
    for table in set(TABLES) - {"costs"}:
        found, expected = (read_table(path / f"{table}.csv") for path in (folder, wanted))
        assert set(found) == set(expected)
        if table == "shape":  # the less a section is oval, the less its axes have a direction
            for shapes in (found, expected):
                shapes["major_angle_rad"] *= shapes["major_semiaxis_m"] - shapes["minor_semiaxis_m"]
        for column, values in expected.items():
            scale = max(np.abs(values).max(), SMALL.get(column, 0.0))
            np.testing.assert_allclose(found[column], values, rtol=0, atol=1e-8 * scale, err_msg=column)
    end = other.series["time_s"][-1]
    for which in GRIDS:
        fields, wanted_fields = (run.fields(end, which).point_data for run in (one, other))
        for name, values in wanted_fields.items():
            np.testing.assert_allclose(fields[name], values, rtol=0, atol=1e-6 * np.abs(values).max(), err_msg=name)


def test_stopped_on_two_ranks_and_resumed_on_three(serial: Path, case_file: Path, tmp_path: Path) -> None:
    """The results of one rank that was never stopped."""
    stop = """
from ngfsi.errors import StoppedError
from ngfsi.run.interrupts import Stops
asked = iter([None, StoppedError('stopped by the test')])
Stops.request = lambda self: next(asked)
"""
    ended = mpirun(2, "run", str(case_file), "--output", str(tmp_path / "run"), "--quiet", before=stop)
    assert ended.returncode == 4, ended.stderr
    stopped = open_run(tmp_path / "run")
    assert (len(stopped.series["time_s"]), stopped.manifest["ranks"]) == (2, 2)
    ended = mpirun(3, "resume", str(tmp_path / "run"))
    assert ended.returncode == 0, ended.stderr
    assert ended.stderr.count("100%") == 1  # rank 0 alone shows progress
    work = [one["cpu_s"] for one in open_run(tmp_path / "run").manifest["work_of_ranks"]]
    assert len(work) == 3
    assert all(min(one[kind] for kind in ("residuals", "solves", "measures", "output")) > 0 for one in work)
    assert_same(tmp_path / "run", serial)


def test_contact_on_two_ranks(tmp_path: Path) -> None:
    """The results of one, from rest until opposite sides of the lumen touch."""
    case_file = tmp_path / "case.toml"
    case_file.write_text(FLOWING.to_toml())
    ended = mpirun(2, "run", str(case_file), "--output", str(tmp_path / "run"), "--quiet")
    assert ended.returncode == 0, ended.stderr
    one = run(exact(FLOWING), tmp_path / "one", quiet=True)
    assert one.series["detF_min_fluid_1"][-1] < 0.3
    assert_same(tmp_path / "run", one.path)


FIELDSPLIT = SQUEEZED.replace(
    **{"solver.linear": "fieldsplit", "solver.tolerance": 1e-8, "time.end": 0.1, "time.smallest_step": 0.1}
)


def test_fieldsplit_ends_where_a_direct_solver_does(tmp_path: Path) -> None:
    """To 1e-8, Newton's tolerance, although GMRES solves to 1e-2."""
    case_file = tmp_path / "case.toml"
    case_file.write_text(FIELDSPLIT.to_toml())
    ended = mpirun(2, "run", str(case_file), "--output", str(tmp_path / "run"), "--quiet")
    assert ended.returncode == 0, ended.stderr
    direct = run(FIELDSPLIT.replace(**{"solver.linear": "auto"}), tmp_path / "direct", quiet=True)
    assert_agrees(tmp_path / "run", direct.path)
    costs = open_run(tmp_path / "run").costs
    assert np.all(costs["iterations"] <= direct.costs["iterations"] + 1)
    assert np.all(costs["linear_iterations"] > costs["iterations"])
    assert np.all(costs["linear_iterations"] <= 4 * costs["iterations"])


def test_iterations_of_fieldsplit(tmp_path: Path) -> None:
    """To 1e-6, from rest and then with new values of the matrix; p-multigrid takes 12. Its
    error is judged by the scales of each renewal."""
    work = f"""
from ngfsi.parallel.ranks import all_ranks
from tests.updates import store
store('{tmp_path / "found.npz"}', 3, all_ranks())
sys.exit()
"""
    ended = mpirun(2, before=work)
    assert ended.returncode == 0, ended.stderr
    found, system = np.load(tmp_path / "found.npz"), system_of(case(3))
    assert np.all(found["iterations"] <= 18)
    exact, _ = updates(3, choose_backend("auto"), Ranks())
    tight, loose = (BLOCKS, 2e-3), ("d", 5e-2)
    for one, other, (names, largest) in zip(found["updates"], exact, (tight, loose, tight), strict=True):
        for name in names:
            a, b = block(system, name, one), block(system, name, other)
            assert np.linalg.norm(a - b) < largest * np.linalg.norm(b), name


def test_fieldsplit_that_fails_ends_the_run(tmp_path: Path) -> None:
    case_file = tmp_path / "case.toml"
    case_file.write_text(FIELDSPLIT.to_toml())
    few = "from ngfsi.linear import multigrid\nmultigrid.MOST_ITERATIONS = 1"
    ended = mpirun(2, "run", str(case_file), "--output", str(tmp_path / "run"), "--quiet", before=few)
    assert ended.returncode == 3, ended.stderr
    said = [line for line in ended.stderr.splitlines() if line.startswith("ngfsi: ")]
    assert len(said) == 1
    assert "GMRES did not solve the linearised system in 1 iterations" in said[0]


FAILS = """
from ngfsi.system.system import System
apply, calls = System.apply, 0
def failing(self):
    global calls
    calls += 1
    if rank == 1 and calls >= 5:
        {how}
    return apply(self)
System.apply = failing
"""


@pytest.mark.parametrize(
    ("how", "code", "sentence"),
    [
        ("self.form = None", 3, "has no attribute 'Apply' (on rank 1 of 2)"),  # in its own part of the work
        ("os.kill(os.getpid(), signal.SIGKILL)", 137, ""),
    ],
)
def test_a_failing_rank_ends_the_run(case_file: Path, tmp_path: Path, how: str, code: int, sentence: str) -> None:
    short = case_file.with_name("short.toml")
    short.write_text(SQUEEZED.replace(**{"time.smallest_step": SQUEEZED.time.step}).to_toml())
    folder = tmp_path / "run"
    ended = mpirun(2, "run", str(short), "--output", str(folder), "--quiet", before=FAILS.format(how=how))
    assert ended.returncode == code, ended.stderr
    said = [line for line in ended.stderr.splitlines() if line.startswith("ngfsi: ")]
    assert len(said) == bool(sentence), ended.stderr
    assert sentence in "".join(said)
    assert "Traceback" not in ended.stderr


def test_one_sentence_for_all_ranks(tmp_path: Path) -> None:
    ended = mpirun(3, "run", str(tmp_path / "missing.toml"))
    assert ended.returncode == 2
    assert ended.stderr.count("ngfsi: ") == 1


def test_commands_for_one_process() -> None:
    two = lonely(0)
    two.size = 2
    with pytest.raises(CaseError, match="mpirun is for ngfsi run and resume: start 'ngfsi study' without it"):
        cli._refuse_ranks(two, ["study", "compare_tissues"])
    cli._refuse_ranks(two, ["resume", "runs/calf"])
    cli._refuse_ranks(Ranks(), ["study", "compare_tissues"])
