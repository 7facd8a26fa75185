"""Mutation testing: small errors planted one at a time, and whether a test notices.

    python -m tests.mutate PAGE [--mutants 300] [--seed 1] [--minutes 30] [--only PATH]

The tests run once under coverage, which tells for each line what tests reach it, those in child processes included.
Then a seeded sample of all mutants of `ngfsi/` and `geometry/` is drawn; each is planted in a copy of the project, and
the tests that reach its line run until one fails: the quick ones first, and of equally quick ones those that reach
little else. PAGE gets the score by room and what survived.

mutmut, cosmic-ray and mutatest were looked at: none of them knows child processes, samples with a seed, or keeps within
a time, and a test suite of minutes allows each mutant only the tests that reach it.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import takewhile
from pathlib import Path
from queue import SimpleQueue

import coverage

from tests.mutate_plugin import FIXTURE

ROOT = Path(__file__).parents[1]
TREES = ("ngfsi", "geometry/ngfsi_geometry")
EQUIVALENT = Path(__file__).with_name("equivalent_mutants.toml")
WORKERS = 2
BUDGET = 30.0
"""Seconds of tests, by their usual duration, that one mutant gets."""
PATIENCE = 4.0
"""How much longer than usual tests may take before a mutant counts as noticed because it hangs."""
ELSEWHERE = "tests/test_ranks.py"
"""Tests in an interpreter of their own, where no coverage is measured: they are tried where no other test comes."""
MPI = ".venv-mpi"
START = 30.0
"""Seconds that a start of pytest may take."""

COMPARED = {
    ast.Lt: ast.GtE,
    ast.GtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
}
COMPUTED = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult}
TOLD = ("description", "help", "title", "doc")
"""Keywords whose values only tell people something."""
NAMES = [("min", "max"), ("sin", "cos"), ("any", "all"), ("argmin", "argmax"), ("inlet", "outlet"), ("first", "last")]
NAMED = {**dict(NAMES), **{there: here for here, there in NAMES}}
UNITS = {
    "Pa": "kPa",
    "kPa": "mmHg",
    "mmHg": "kPa",
    "s": "ms",
    "ms": "s",
    "m": "mm",
    "mm": "m",
    "m2": "mm2",
    "mm2": "m2",
}


@dataclass(frozen=True)
class Mutant:
    """An expression or statement of a file, by its place in bytes, and what stands there instead."""

    path: str
    line: int
    start: int
    end: int
    old: str
    new: str

    @property
    def change(self) -> str:
        """What is written in place of what, with as much of it as tells."""
        old, new = self.old, " ".join(self.new.split())
        if len(old) > 100:
            same = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(old, new, strict=False)))
            old, new = (f"...{text[max(0, same - 30) : same + 30]}..." for text in (old, new))
        return f"{old} -> {new}"

    @property
    def room(self) -> str:
        parts = Path(self.path).parts
        return "/".join(parts[:2]) if len(parts) > 2 and parts[0] == "ngfsi" else parts[0]

    def planted(self, source: bytes) -> bytes:
        return source[: self.start] + self.new.encode() + source[self.end :]

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.change}"


def mutants_of(path: str, source: str) -> Iterator[Mutant]:
    """Yield the mutants of a file, in the order of the file."""
    tree = ast.parse(source)
    starts = [0]
    for line in source.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    for node, new in _changes(tree):
        start = starts[node.lineno - 1] + node.col_offset
        end = starts[(node.end_lineno or node.lineno) - 1] + (node.end_col_offset or 0)
        old = source.encode()[start:end].decode()
        if new != old:
            yield Mutant(path, node.lineno, start, end, " ".join(old.split()), new)


def _changes(node: ast.AST) -> Iterator[tuple[ast.expr | ast.stmt, str]]:
    """Yield each changed node of a tree and its new source; what only tells people or the type checker stays."""
    if isinstance(node, ast.Raise | ast.JoinedStr | ast.Assert | ast.Import | ast.ImportFrom):
        return
    if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
        return
    yield from _of(node)
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _changes(child)


def _of(node: ast.AST) -> Iterator[tuple[ast.expr | ast.stmt, str]]:
    """Yield the changes of one node."""
    match node:
        case ast.Constant(value=value) if (changed := _constant(value)) is not None:
            yield node, changed
        case ast.Name(id=name, ctx=ast.Load()) if name in NAMED:
            yield node, NAMED[name]
        case ast.Attribute(attr=name, ctx=ast.Load()) if name in NAMED:
            yield node, f"{ast.unparse(node.value)}.{NAMED[name]}"
        case ast.Call():
            for keyword in node.keywords:
                if keyword.arg and keyword.arg not in TOLD:
                    others = [other for other in node.keywords if other is not keyword]
                    yield node, ast.unparse(ast.Call(node.func, node.args, others))
        case ast.AugAssign() | ast.Expr(value=ast.Call()):
            yield node, "pass"
        case ast.expr() if (operation := _operation(node)) is not None:
            yield node, f"({ast.unparse(operation)})"


def _operation(node: ast.expr) -> ast.expr | None:
    """Return an operation with another operator."""
    match node:
        case ast.Compare(ops=[op, *_]) if type(op) in COMPARED:
            return ast.Compare(node.left, [COMPARED[type(op)](), *node.ops[1:]], node.comparators)
        case ast.BinOp(op=op) if type(op) in COMPUTED and not _is_text(node.left) and not _is_text(node.right):
            return ast.BinOp(node.left, COMPUTED[type(op)](), node.right)
        case ast.BoolOp(op=op):
            return ast.BoolOp(ast.Or() if isinstance(op, ast.And) else ast.And(), node.values)
        case ast.UnaryOp(op=ast.USub() | ast.Not(), operand=operand):
            return operand
    return None


def _constant(value: object) -> str | None:
    """Return another value of the same kind: a number that is a little wrong, a unit that is another."""
    match value:
        case bool():
            return str(not value)
        case int():
            return str(value + 1)
        case float():
            return repr(value * 1.1 if value else 0.1)
        case str() if value in UNITS:
            return repr(UNITS[value])
    return None


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))


def sample(paths: Sequence[str], count: int, seed: int) -> list[Mutant]:
    """Draw so many of the mutants of the files, each at most once."""
    everything = [mutant for path in paths for mutant in mutants_of(path, (ROOT / path).read_text(encoding="utf-8"))]
    return random.Random(seed).sample(everything, min(count, len(everything)))


@cache
def _in_functions(path: str) -> frozenset[int]:
    """Return the lines of a file that are in the body of a function."""
    functions = (node for node in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8")))
                 if isinstance(node, ast.FunctionDef | ast.Lambda))  # fmt: skip
    bodies = (part for one in functions for part in (one.body if isinstance(one.body, list) else [one.body]))
    return frozenset(line for part in bodies for line in range(part.lineno, (part.end_lineno or part.lineno) + 1))


class Reach:
    """What tests reach which line of which file, and how long they take; measured by running them all once."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.tests: dict[str, dict[int, set[str]]] = defaultdict(lambda: defaultdict(set))
        self.lines: dict[str, int] = defaultdict(int)

    @classmethod
    def measured(cls, folder: Path) -> Reach:
        """Run the tests under coverage, with all files of that in `folder`; what is there already is read again."""
        here = cls()
        notes, data = folder / "notes", folder / "lines"
        if not data.exists():
            _run_covered(folder, notes, data)
            combined = coverage.Coverage(data_file=str(data), config_file=False)
            combined.combine([str(folder)])
            combined.save()
        users: dict[str, set[str]] = defaultdict(set)
        for line in notes.read_text(encoding="utf-8").splitlines():
            kind, value, test = line.split(" ", 2)
            if kind == "uses":
                users[FIXTURE + value].add(test)
            else:
                here.seconds[test] += float(value)
        found = coverage.CoverageData(str(data))
        found.read()
        for file in found.measured_files():
            for line_number, contexts in found.contexts_by_lineno(file).items():
                names = {context.split("|")[0].split(" (")[0] for context in contexts}
                tests = (names & here.seconds.keys()).union(*(users[name] for name in names))
                here.tests[file][line_number] = tests
                for test in tests:
                    here.lines[test] += 1
        return here

    def of(self, mutant: Mutant) -> list[str]:
        """Return the tests of a mutant within the budget: the quick ones that reach little else first.

        Those of a line outside of functions are those that reach a function of its file. After them come the others of
        their modules, which may look at what one of them has made.
        """
        lines = self.tests[mutant.path]
        reaching = lines[mutant.line]
        inside = _in_functions(mutant.path)
        if mutant.line not in inside:  # carried out by whoever imports it first: any user may notice
            reaching = reaching.union(*(lines[line] for line in inside if line in lines))
        if not reaching:
            reaching = {test for test in self.seconds if test.startswith(f"{ELSEWHERE}::")}
        modules = {test.split("::")[0] for test in reaching}
        others = {test for test in self.seconds if test.split("::")[0] in modules} - reaching
        chosen, total = [], 0.0
        for test in (*sorted(reaching, key=self._cost), *sorted(others, key=self._cost)):
            total += self.seconds[test]
            if total < BUDGET or not chosen:
                chosen.append(test)
        return chosen

    def _cost(self, test: str) -> tuple[float, str]:
        return (self.seconds[test] + 0.1) * self.lines[test], test


def _run_covered(folder: Path, notes: Path, data: Path) -> None:
    """Run the tests under coverage: theirs by pytest-cov, that of child processes by a `sitecustomize`."""
    folder.mkdir(parents=True, exist_ok=True)
    sources = "".join(f"    {tree}\n" for tree in TREES)
    common = f"[run]\ndata_file = {data}\nparallel = true\nrelative_files = true\ncore = ctrace\nsource =\n{sources}"
    settings, child = folder / "coverage.ini", folder / "child.ini"
    settings.write_text(common, encoding="utf-8")
    child.write_text(common + "context = ${PYTEST_CURRENT_TEST-}\n", encoding="utf-8")
    (folder / "sitecustomize.py").write_text("import coverage\ncoverage.process_startup()\n", encoding="utf-8")
    notes.unlink(missing_ok=True)
    paths = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | {"PYTHONPATH": paths, "MUTATE_CHILD": str(child), "MUTATE_NOTES": str(notes)}
    options = ["--cov", "--cov-report=", "--cov-context=test", f"--cov-config={settings}", "-p", "tests.mutate_plugin"]
    command = [sys.executable, "-m", "pytest", "-n", str(WORKERS), "--dist", "worksteal", *options]
    if subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode:
        sys.exit("the tests fail without any mutant: mend that first")


@dataclass(frozen=True)
class Verdict:
    mutant: Mutant
    fate: str
    """Killed, hangs, survived, or unreached."""
    test: str = ""


def try_out(mutant: Mutant, tests: Sequence[str], usual: float, copy: Path) -> Verdict:
    """Plant a mutant in a copy of the project and run tests there until one fails."""
    if not tests:
        return Verdict(mutant, "unreached")
    file = copy / mutant.path
    source = file.read_bytes()
    file.write_bytes(mutant.planted(source))
    names = copy / "chosen-tests"
    names.write_text("\n".join(tests), encoding="utf-8")
    paths = os.pathsep.join(str(copy / part) for part in (".", "geometry", "studies"))
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "--tb=no", "-rfE", f"@{names}"]
    process = subprocess.Popen(
        command,
        cwd=copy,
        env=os.environ | {"PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        said, _ = process.communicate(timeout=START + PATIENCE * usual)
    except subprocess.TimeoutExpired:
        return Verdict(mutant, "hangs")
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, 9)
        process.wait()
        file.write_bytes(source)
    if process.returncode == 0:
        return Verdict(mutant, "survived")
    failed = [line for line in said.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return Verdict(mutant, "killed", failed[0].split()[1] if failed else "at import")


def judge(mutants: Sequence[Mutant], reach: Reach, until: float) -> list[Verdict]:
    """Try the mutants on several copies of the project, as many as time allows, and show how it goes."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copies: SimpleQueue[Path] = SimpleQueue()
        for number in range(WORKERS):
            copies.put(_copied(Path(folder) / str(number)))

        def one(mutant: Mutant) -> Verdict | None:
            if time.monotonic() > until:
                return None
            copy, tests = copies.get(), reach.of(mutant)
            try:
                verdict = try_out(mutant, tests, sum(reach.seconds[test] for test in tests), copy)
            finally:
                copies.put(copy)
            print(f"{verdict.fate:9} {mutant}  {verdict.test}", flush=True)
            return verdict

        with ThreadPoolExecutor(WORKERS) as pool:
            return [verdict for verdict in pool.map(one, mutants) if verdict]


def _copied(destination: Path) -> Path:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in listed.splitlines():
        if (ROOT / name).is_file():
            (destination / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, destination / name)
    if (ROOT / MPI).exists():
        (destination / MPI).symlink_to(ROOT / MPI)
    return destination


def page(verdicts: Sequence[Verdict], drawn: int, command: str, reasons: dict[str, str]) -> str:
    """Return the page: the score by room, what survived, and why some of that is no error."""
    text = ["# Mutation testing", "", f"`{command}`: {len(verdicts)} of {drawn} mutants tried.", ""]
    text += ["| room | mutants | noticed | equivalent | score (%) |", "|---|---|---|---|---|"]
    rooms: dict[str, list[Verdict]] = defaultdict(list)
    for verdict in verdicts:
        rooms[verdict.mutant.room].append(verdict)
    for room, those in [*sorted(rooms.items()), ("all", list(verdicts))]:
        noticed = sum(verdict.fate in ("killed", "hangs") for verdict in those)
        equal = sum(f"{verdict.mutant.path}: {verdict.mutant.change}" in reasons for verdict in those)
        score = 100 * noticed / max(1, len(those) - equal)
        text.append(f"| {room} | {len(those)} | {noticed} | {equal} | {score:.0f}{' **below 75**' * (score < 75)} |")
    text += ["", "## Not noticed", ""]
    for verdict in verdicts:
        if verdict.fate in ("survived", "unreached"):
            reason = reasons.get(f"{verdict.mutant.path}: {verdict.mutant.change}", "")
            reason = f"; equivalent: {reason}" if reason else ""
            text.append(f"- `{verdict.mutant}` ({verdict.fate}{reason})")
    return "\n".join(text) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("page", type=Path)
    parser.add_argument("--mutants", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--only", default="", help="files whose path begins so")
    parser.add_argument("--reach", type=Path, help="folder for what tests reach which line; used again if it is there")
    options = parser.parse_args()
    start = time.monotonic()
    paths = sorted(str(path.relative_to(ROOT)) for tree in TREES for path in (ROOT / tree).rglob("*.py"))
    mutants = sample([path for path in paths if path.startswith(options.only)], options.mutants, options.seed)
    with tempfile.TemporaryDirectory() as scratch:
        reach = Reach.measured((options.reach or Path(scratch)).resolve())
    verdicts = judge(mutants, reach, start + 60 * options.minutes)
    reasons = tomllib.loads(EQUIVALENT.read_text(encoding="utf-8"))["equivalent"] if EQUIVALENT.exists() else {}
    command = f"python -m tests.mutate --mutants {options.mutants} --seed {options.seed}"
    options.page.write_text(page(verdicts, len(mutants), command, reasons), encoding="utf-8")


if __name__ == "__main__":
    main()
