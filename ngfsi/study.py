"""Studies: run many cases, reuse what is there, go on when one fails, and tabulate.

Each case runs in a process of its own (`python -m ngfsi.study CASE FOLDER`), so that a crash of one leaves the others
alone; a few run side by side, the processors shared out among them.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path

import ngfsi
from ngfsi.case import Case
from ngfsi.errors import NgfsiError, OutputError
from ngfsi.output.disk import explained
from ngfsi.output.folder import CASE
from ngfsi.output.progress import Watch
from ngfsi.output.stored import StoredRun, open_run
from ngfsi.run import run

ENTREATIES, ENTREATY_SECONDS = 12, 5.0
"""How often, and how long apart, an interrupted run is asked to end before it is killed."""


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
    cases: Mapping[str, Case], folder: Path, *, processes: int = 2, quiet: bool = False
) -> dict[str, Outcome]:
    """Run cases, each in the subfolder of its key, and return what became of each, in their order.

    A finished run of an equal case by the same version is reused; an unfinished one of an equal case is repeated from
    the start; the run of another case is moved aside. Ctrl-C ends all runs and keeps what they stored.

    Args:
        cases: key, which names the subfolder -> case.
        folder: parent of the runs' folders.
        processes: how many runs to compute at a time; the processors are shared out among them.
        quiet: show no progress.

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
        for key, outcome in _compute_all(missing, folder, side_by_side, watch):
            outcomes[key] = outcome
            watch.finished(key, outcome.failure)
    return {key: outcomes[key] for key in cases}


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown, the first column aligned left, the others right."""
    lines = [_line(head), _line(["---", *(["---:"] * (len(head) - 1))])]
    return "\n".join([*lines, *(_line(row) for row in rows)]) + "\n"


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _reusable(folder: Path, case: Case) -> Outcome | None:
    """Return the finished run of an equal case in the folder, if there is one."""
    try:
        run = open_run(folder)
        same = run.case.digest == case.digest and run.manifest.get("versions", {}).get("ngfsi") == ngfsi.__version__
    except NgfsiError:
        return None
    return Outcome(run, reused=True) if same and run.status == "completed" else None


def _clear(folder: Path, case: Case) -> None:
    """Make room for a run: remove an unfinished one of the same case, move anything else aside."""
    if not folder.exists():
        return
    try:
        same = open_run(folder).case.digest == case.digest
    except NgfsiError:
        same = False
    with explained(folder, "replaced"):
        if same:
            shutil.rmtree(folder)
        else:
            folder.rename(folder.with_name(f"{folder.name}.until-{time.strftime('%Y%m%d-%H%M%S')}"))


def _compute_all(
    cases: Mapping[str, Case], folder: Path, side_by_side: int, watch: Watch
) -> Iterator[tuple[str, Outcome]]:
    """Run cases in child processes and yield what became of each as it ends."""
    children: list[subprocess.Popen[str]] = []
    threads = max(1, (os.cpu_count() or 1) // side_by_side)
    pool = ThreadPoolExecutor(side_by_side)
    try:
        waiting = {pool.submit(_compute, c, folder / key, threads, children): key for key, c in cases.items()}
        while waiting:
            done, _ = wait(waiting, timeout=0.5, return_when=FIRST_COMPLETED)
            watch.look()
            for finished in done:
                key = waiting.pop(finished)
                yield key, _outcome(finished.result(), folder / key)
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        _interrupt(children)
        raise
    finally:
        pool.shutdown()


def _interrupt(children: Sequence[subprocess.Popen[str]]) -> None:
    """Ask child processes to end, again and again: one that calls a compiler at the moment does not hear it."""
    for _ in range(ENTREATIES):
        living = [child for child in children if child.poll() is None]
        for child in living:
            child.send_signal(signal.SIGINT)
        deadline = time.monotonic() + ENTREATY_SECONDS
        while time.monotonic() < deadline and any(child.poll() is None for child in living):
            time.sleep(0.1)
    for child in children:
        if child.poll() is None:
            os.killpg(child.pid, signal.SIGKILL)  # with the compiler it may have started, which holds our pipe open


def _compute(case: Case, folder: Path, threads: int, children: list[subprocess.Popen[str]]) -> tuple[int, str]:
    """Run a case in a child process, noted in `children`; return its exit code and what it said on standard error.

    NGSolve and MKL take the number of threads from the environment.
    """
    request = folder.with_name(f"{folder.name}.{CASE}")
    request.write_text(case.to_toml(), encoding="utf-8")
    command = [sys.executable, "-m", "ngfsi.study", str(request), str(folder)]
    numbers = dict.fromkeys(("NGS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), str(threads))
    environment = os.environ | numbers | {"PYTHONPATH": os.pathsep.join(entry for entry in sys.path if entry)}
    # a session of its own keeps the terminal's Ctrl-C from it, which `_compute_all` passes on once
    child = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True)
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
    last = (said.strip().splitlines() or ["it said nothing"])[-1]
    stored = str(run.manifest.get("reason", "")) if run else ""
    return Outcome(run, failure=stored or (f"its process was ended by signal {-code}" if code < 0 else last))


def main(case_file: Path, folder: Path) -> int:
    """Child process: run one case; the last line on standard error says why it failed."""
    try:
        run(Case.from_toml(case_file), folder, quiet=True)
    except NgfsiError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
