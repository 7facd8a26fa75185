"""Studies: run many cases, reuse what is there, go on when one fails, and tabulate.

Each case runs in a process of its own, so that a crash of one leaves the others
alone; a few run side by side, the processors shared out among them. Who starts these processes is any executor of
concurrent.futures: threads here by default, or one whose workers are elsewhere and see the same folders.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, ProcessPoolExecutor, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path

import ngfsi
from ngfsi import process, registry
from ngfsi.case import Case
from ngfsi.errors import CaseError, NgfsiError, OutputError
from ngfsi.parallel.ranks import threads
from ngfsi.report.tables import markdown_table
from ngfsi.run import resume, run
from ngfsi.run.progress import Watch
from ngfsi.store.disk import explained, replace_file
from ngfsi.store.folder import CASE, CHECKPOINTS, MANIFEST, STOP
from ngfsi.store.stored import StoredRun, open_run
from ngfsi.store.table import write_parquet, write_rows
from ngfsi.study.design import Design

PATIENCE = (30.0, 30.0)
"""Seconds that an interrupted run has to end after its step, and then, asked again, at once, before it is killed."""

HASH = 16
"""Digits of the hash of a case that name the folder of its run."""


@dataclass(frozen=True)
class Outcome:
    """What became of one case of a study.

    Attributes:
        run: what was stored; None when the run failed before its folder was made.
        failure: why it did not reach its end; empty when it did.
        reused: whether a finished run of the same case was there already.
    """

    run: StoredRun | None
    failure: str = ""
    reused: bool = False


def run_cases(
    cases: Mapping[str, Case], folder: Path, *, processes: int = 2, quiet: bool = False,
    executor: Executor | None = None,
) -> dict[str, Outcome]:  # fmt: skip
    """Run cases, each in the subfolder of its key, and return what became of each, in their order.

    A finished run of an equal case by the same version is reused, and so is one that failed (see `forget_failed`); an
    unfinished one of an equal case goes on from its last checkpoint; the run of another case is moved aside. Ctrl-C
    ends all runs and keeps what they stored.

    Args:
        processes: how many runs to compute at a time; the processors are shared out among them.
        quiet: show no progress.
        executor: starts the runs, with one thread each; default: here, `processes` at a time.

    Raises:
        OutputError: the folder cannot be written.
    """
    with explained(folder, "made"):
        folder.mkdir(parents=True, exist_ok=True)
    outcomes = {key: outcome for key, case in cases.items() if (outcome := _reusable(folder / key, case))}
    missing = {key: case for key, case in cases.items() if key not in outcomes}
    side_by_side = max(1, min(processes, len(missing), os.cpu_count() or 1))
    for key, case in missing.items():
        _clear(folder / key, case)
    with Watch({key: (folder / key, case.time.end) for key, case in missing.items()}, quiet=quiet) as watch:
        for key, outcome in _compute_all(missing, folder, side_by_side, watch, executor):
            outcomes[key] = outcome
            watch.finished(key, outcome.failure)
    return {key: outcomes[key] for key in cases}


@contextmanager
def workers() -> Iterator[Executor]:
    """Let functions of modules be computed in as many processes as there are processors, with one thread each.

    What they take and return goes from process to process, and so do no systems or meshes.
    """
    before = dict(os.environ)
    os.environ.update(threads(1))
    pool = ProcessPoolExecutor(
        os.cpu_count() or 1, get_context("spawn"), initializer=registry.load, initargs=(registry.plugins(),)
    )
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)
        os.environ.clear()
        os.environ.update(before)


@dataclass(frozen=True)
class Study:
    """Cases, and what to tabulate of each.

    Attributes:
        name: names the files of the results.
        cases: key -> case.
        columns: name with unit -> the number for a finished run.
        inputs: key -> what distinguishes the case: name with unit -> value; shown before the columns.
    """

    name: str
    cases: Mapping[str, Case]
    columns: Mapping[str, Callable[[StoredRun], float]]
    inputs: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @classmethod
    def of(cls, name: str, design: Design, base: Case, columns: Mapping[str, Callable[[StoredRun], float]]) -> Study:
        """Return the study of a design around a case."""
        return cls(name, design.cases(base), columns, design.values())


@dataclass(frozen=True)
class Results:
    """What a study gave: by key outcomes and, of finished runs, the numbers by column; and the page that shows them."""

    outcomes: Mapping[str, Outcome]
    table: Mapping[str, Mapping[str, float]]
    report: Path


def run_study(
    study: Study, folder: Path, executor: Executor | None = None, *, retry_failed: bool = False, quiet: bool = False
) -> Results:
    """Run a study's cases, with one thread each, and write one table and one report of all.

    The table is `<name>.csv`, and `<name>.parquet` where pyarrow is installed; the report, `<name>.md`, shows it with a
    figure of every result over every input and with the failures.

    Runs lie in `folder/runs` by the hash of their content: what is finished is never run again, whatever its key, and
    what was stopped or killed goes on.

    Args:
        executor: any of concurrent.futures, e.g. of executorlib; default: as many processes here as processors.
        retry_failed: whether cases that failed before are computed again.

    Raises:
        CaseError: the study has no cases.
        OutputError: the folder cannot be written.
    """
    if not study.cases:
        raise CaseError(f"the study '{study.name}' has no cases: there is nothing to run")
    if retry_failed:
        forget_failed(folder)
    digests = {key: case.digest[:HASH] for key, case in study.cases.items()}
    distinct = {digests[key]: case for key, case in study.cases.items()}
    found = run_cases(distinct, folder / "runs", processes=os.cpu_count() or 1, quiet=quiet, executor=executor)
    outcomes = {key: found[digest] for key, digest in digests.items()}
    table = {
        key: {name: float(number(outcome.run)) for name, number in study.columns.items()}
        for key, outcome in outcomes.items()
        if outcome.run is not None and not outcome.failure
    }
    return Results(outcomes, table, _report(study, folder, outcomes, digests, table))


def _report(
    study: Study, folder: Path, outcomes: Mapping[str, Outcome], digests: Mapping[str, str],
    table: Mapping[str, Mapping[str, float]],
) -> Path:  # fmt: skip
    """Write table, figure and page, and return the page's path."""
    inputs = list(next(iter(study.inputs.values()), ()))
    rows: list[dict[str, float | str]] = [
        {"case": key, **{name: study.inputs[key][name] for name in inputs},
         **{name: table[key][name] if key in table else "" for name in study.columns}, "run": digests[key]}
        for key in study.cases
    ]  # fmt: skip
    write_rows(folder / f"{study.name}.csv", rows)
    files = [f"[{study.name}.csv]({study.name}.csv)"]
    if write_parquet(folder / f"{study.name}.parquet", rows):
        files.append(f"[{study.name}.parquet]({study.name}.parquet)")
    page = [f"# {study.name}: {len(table)} of {len(rows)} cases", "", *_costs(outcomes), ""]
    if table:
        from ngfsi.report.figures import results_over_inputs  # Matplotlib, which the child processes do without

        over = {name: [study.inputs[key][name] for key in table] for name in inputs}
        found = {name: [table[key][name] for key in table] for name in study.columns}
        results_over_inputs(over or {"number of the case": range(len(table))}, found, folder / f"{study.name}.png")
        page += [f"![results]({study.name}.png)", ""]
    shown = [[f"{cell:.6g}" if isinstance(cell, float) else str(cell) for cell in row.values()] for row in rows]
    page += [markdown_table(list(rows[0]), shown), f"The numbers in full: {', '.join(files)}."]
    failures = [f"- {key} (runs/{digests[key]}): {one.failure}" for key, one in outcomes.items() if one.failure]
    if failures:
        page += ["", f"{len(failures)} failed, and are computed again on request (`--retry-failed`):", "", *failures]
    target = folder / f"{study.name}.md"
    replace_file(target, ("\n".join(page) + "\n").encode())
    return target


def _costs(outcomes: Mapping[str, Outcome]) -> list[str]:
    """Return what the runs cost, in a sentence."""
    manifests = {outcome.run.path: outcome.run.manifest for outcome in outcomes.values() if outcome.run}
    seconds = [sum(manifest.get("seconds", {}).values()) for manifest in manifests.values()]
    if not any(seconds):
        return []
    reused = sum(outcome.reused for outcome in outcomes.values())
    return [f"{len(manifests)} runs took {sum(seconds):.0f} s, {max(seconds):.0f} s the longest; {reused} were there."]


def _stored(folder: Path, case: Case) -> StoredRun | None:
    """Return the run of an equal case in the folder, if there is one."""
    try:
        run = open_run(folder)
        return run if run.case.digest == case.digest else None
    except NgfsiError:
        return None


def _reusable(folder: Path, case: Case) -> Outcome | None:
    """Return the run of an equal case by this version that is over, completed or failed, if there is one."""
    run, known = _stored(folder, case), {"ngfsi": ngfsi.__version__, **registry.versions()}
    if run is None or not known.items() <= run.manifest.get("versions", {}).items():
        return None
    if run.status == "failed":
        return Outcome(run, failure=str(run.manifest.get("reason", "")), reused=True)
    return Outcome(run, reused=True) if run.status == "completed" else None


def forget_failed(folder: Path) -> list[Path]:
    """Remove the runs that failed from a study's folder, so that they are computed again, and return which.

    Raises:
        OutputError: a folder cannot be removed.
    """
    found = [path.parent for depth in ("*", "runs/*") for path in sorted(folder.glob(f"{depth}/{MANIFEST}"))]
    failed = [path for path in found if open_run(path).status == "failed"]
    for path in failed:
        with explained(path, "removed"):
            shutil.rmtree(path)
    return failed


def _clear(folder: Path, case: Case) -> None:
    """Make room for a run: keep one of the same case that can go on, remove a failed one, move anything else aside."""
    if not folder.exists():
        return
    run = _stored(folder, case)
    with explained(folder, "replaced"):
        if run and run.status in ("running", "interrupted") and any((folder / CHECKPOINTS).glob("*")):
            return
        if run:
            shutil.rmtree(folder)
        else:
            folder.rename(folder.with_name(f"{folder.name}.until-{time.strftime('%Y%m%d-%H%M%S')}"))


def _compute_all(
    cases: Mapping[str, Case], folder: Path, side_by_side: int, watch: Watch, executor: Executor | None
) -> Iterator[tuple[str, Outcome]]:
    """Run cases in child processes and yield what became of each as it ends."""
    children: list[subprocess.Popen[str]] = []
    count = 1 if executor else max(1, (os.cpu_count() or 1) // side_by_side)
    pool, known = executor or ThreadPoolExecutor(side_by_side), registry.plugins()
    waiting = {
        pool.submit(_compute, case.to_toml(), folder / key, count, children, known): key for key, case in cases.items()
    }
    try:
        while waiting:
            done, _ = wait(waiting, timeout=0.5, return_when=FIRST_COMPLETED)
            watch.look()
            for finished in done:
                key, error = waiting.pop(finished), finished.exception()
                ended = (1, f"{type(error).__name__}: {error}") if error else finished.result()
                yield key, _outcome(ended, folder / key)
    except BaseException:  # also where the caller looks no further
        for future, key in waiting.items():
            if not future.cancel() and (folder / key).is_dir():
                (folder / key / STOP).touch()
        _interrupt(children)
        raise
    finally:
        if executor is None:
            pool.shutdown()


def _interrupt(children: Sequence[subprocess.Popen[str]]) -> None:
    """Ask child processes to end after their step, then to end at once, and kill those that do neither."""
    for patience in PATIENCE:
        living = [child for child in children if child.poll() is None]
        for child in living:
            child.send_signal(signal.SIGINT)
        deadline = time.monotonic() + patience
        while time.monotonic() < deadline and any(child.poll() is None for child in living):
            time.sleep(0.1)
    for child in children:
        if child.poll() is None:
            os.killpg(child.pid, signal.SIGKILL)  # with the mesher it may have started, which holds our pipe open


def _compute(
    case: str, folder: Path, count: int, children: list[subprocess.Popen[str]], plugins: Sequence[str]
) -> tuple[int, str]:
    """Run a case, given as the text of its file, in a child process with `count` threads, noted in `children`.

    Args:
        plugins: what the case needs to be known here, where the process that submitted it may not be.

    Returns its exit code and what it said on standard error.
    """
    registry.load(plugins)
    request = folder.with_name(f"{folder.name}.{CASE}")
    request.write_text(case, encoding="utf-8")
    # a session of its own keeps the terminal's Ctrl-C from it, which `_compute_all` passes on once
    child = process.start("ngfsi.study.engine:main", request, folder, more=threads(count), start_new_session=True)
    children.append(child)
    said = child.communicate()[1]
    request.unlink()
    return child.returncode, said


def _outcome(ended: tuple[int, str], folder: Path) -> Outcome:
    """Return what became of a child process."""
    code, said = ended
    try:
        run = open_run(folder)
    except OutputError:
        run = None
    if code == 0:
        return Outcome(run)
    last = process.last_line(said)
    stored = str(run.manifest.get("reason", "")) if run else ""
    return Outcome(run, failure=stored or (f"its process was ended by signal {-code}" if code < 0 else last))


def main(case_file: str, folder: str) -> None:
    """Child process: run one case, or go on with it."""
    if (Path(folder) / CASE).exists():
        resume(Path(folder), quiet=True)
    else:
        run(Case.from_toml(case_file), Path(folder), quiet=True)
