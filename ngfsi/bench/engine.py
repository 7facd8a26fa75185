"""Benchmarks of speed: whole runs as processes of their own, by turns, so that both meet the same moods of the machine.

What counts are ratios to the baseline; seconds, which are stored beside, are of one machine on one day. The named
cases and variants are in modules registered in the group `ngfsi.bench`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, Literal, NamedTuple

from rich.table import Table

from ngfsi import process, registry
from ngfsi.case import Case
from ngfsi.errors import OutputError, SolverError, unknown
from ngfsi.mesh.domain import Domain
from ngfsi.parallel.ranks import threads
from ngfsi.solve.initial import Say, silent
from ngfsi.store.disk import explained
from ngfsi.store.provenance import commit, machine, versions
from ngfsi.store.stored import StoredRun, mean_over_steps, open_run
from ngfsi.units import from_si

BASELINE = "baseline"
OUTSIDE = "start of Python, and what no phase knows"


class Setup(NamedTuple):
    """What is run: a case, and with how many threads; default: as many as the environment says."""

    case: Case
    threads: int | None = None


@dataclass(frozen=True)
class Sample:
    """What one run took.

    Attributes:
        seconds: on the clock, from the start of the process to its end.
        memory: largest resident set of the process, in MB.
        phases: seconds by kind of work, which sum to `seconds`.
        whole_s: the seconds of all steps of the case, extrapolated if only the first were run.
        results: what was computed: volume of the lumen at the end, mean of SAWSS over the steps; of runs in the plane
            nothing.
    """

    seconds: float
    memory: float
    unknowns: int
    steps: int
    iterations: int
    factorisations: int
    whole_s: float
    phases: Mapping[str, float]
    results: Mapping[str, float]


QUANTITIES = {
    "whole_s": "seconds",
    "memory": "memory, MB",
    "factorisations": "factorisations",
    "iterations": "iterations",
    "unknowns": "unknowns",
}


def run_sample(setup: Setup, steps: int | None = None) -> Sample:
    """Run a case, or its first steps, in a process of its own and return what it took.

    Raises:
        SolverError: the run failed; says why.
    """
    case, planned = setup.case, setup.case.time.steps
    count = min(steps or planned, planned)
    with TemporaryDirectory(prefix="ngfsi-bench-") as folder:
        file, target = Path(folder) / "case.toml", Path(folder) / "run"
        shorter = case.replace(**{"time.end": count * case.time.step, "output.fields_every": 0})
        file.write_text(shorter.to_toml(), encoding="utf-8")
        started = perf_counter()
        child = process.start(
            "ngfsi.study.engine:main", file, target, more=threads(setup.threads) if setup.threads else None
        )
        assert child.stderr is not None
        said = child.stderr.read()
        _, status, usage = os.wait4(child.pid, 0)
        seconds = perf_counter() - started
        child.returncode = os.waitstatus_to_exitcode(status)
        if child.returncode:
            raise SolverError(process.last_line(said, "it said nothing"))
        stored = open_run(target)
        manifest, costs = stored.manifest, stored.costs
        results = _results(stored)
    phases = {str(name): float(value) for name, value in manifest["seconds"].items()}
    phases[OUTSIDE] = seconds - sum(phases.values())
    return Sample(
        seconds=seconds,
        memory=usage.ru_maxrss / 1024,
        unknowns=int(manifest["unknowns"]),
        steps=len(costs["step"]),
        iterations=int(costs["iterations"].sum()),
        factorisations=int(manifest["factorisations"]),
        whole_s=seconds + (planned - count) * (float(costs["wall_s"].sum()) / count + phases["measures"] / (count + 1)),
        phases=phases,
        results=results,
    )


def _results(run: StoredRun) -> dict[str, float]:
    series = run.series
    if "sawss_Pa" not in series:
        return {}
    volume, sawss = series["lumen_volume_m3"][-1], mean_over_steps(series, "sawss_Pa")
    return {"lumen, mm3": from_si(float(volume), "mm3"), "mean SAWSS, Pa": float(sawss)}


@dataclass(frozen=True)
class Comparison:
    """Samples of a case, the baseline, and of a variant, taken by turns.

    Attributes:
        steps: number that was run, of `planned`.
        samples: by variant; the first is the baseline.
    """

    name: str
    steps: int
    planned: int
    samples: Mapping[str, Sequence[Sample]]

    def ratios(self, variant: str, quantity: str) -> list[float]:
        """Return a variant's values over those of the baseline, pair by pair."""
        pairs = zip(self.samples[variant], self.samples[BASELINE], strict=True)
        return [getattr(one, quantity) / getattr(plain, quantity) for one, plain in pairs]

    def results(self) -> dict[str, dict[str, float]]:
        """Return what was computed, the same in every run of a variant, by quantity and variant."""
        first = {name: samples[0].results for name, samples in self.samples.items()}
        return {what: {name: found[what] for name, found in first.items()} for what in first[BASELINE]}

    def table(self) -> Table:
        """Return medians, and the ratios with their spread."""
        extrapolated = f"; seconds extrapolated from {self.steps} of {self.planned} steps"
        title = self.name + (extrapolated if self.steps < self.planned else "")
        table = Table("", *self.samples, *(f"{name} over {BASELINE}" for name in self._variants()), title=title)
        for quantity, label in QUANTITIES.items():
            values = [median(getattr(one, quantity) for one in samples) for samples in self.samples.values()]
            ratios = [self.ratios(name, quantity) for name in self._variants()]
            shown = (f"{median(r):.3g} ({min(r):.3g} to {max(r):.3g})" for r in ratios)
            table.add_row(label, *(f"{v:.4g}" for v in values), *shown)
        for what, values_of in self.results().items():
            over = (f"{values_of[name] / values_of[BASELINE]:.5f}" for name in self._variants())
            table.add_row(what, *(f"{value:.5g}" for value in values_of.values()), *over)
        for phase, seconds in self.phases().items():
            plain = seconds[BASELINE]
            over = (f"{seconds[name] / plain:.2g}" if plain else "" for name in self._variants())
            table.add_row(f"{phase}, s", *(f"{value:.3g}" for value in seconds.values()), *over)
        return table

    def phases(self) -> dict[str, dict[str, float]]:
        """Return the median seconds of each kind of work of each variant, as run."""
        kinds = dict.fromkeys(phase for samples in self.samples.values() for one in samples for phase in one.phases)
        return {
            kind: {name: median(one.phases.get(kind, 0.0) for one in samples) for name, samples in self.samples.items()}
            for kind in kinds
        }

    def write(self, folder: Path) -> Path:
        """Store everything as JSON with the versions that it was measured with, and return its path.

        Raises:
            OutputError: the folder cannot be written.
        """
        path = folder / f"{self.name}.json"
        with explained(path):
            folder.mkdir(parents=True, exist_ok=True)
            ratios = {name: {q: self.ratios(name, q) for q in QUANTITIES} for name in self._variants()}
            about = {"versions": versions(), "commit": commit(), "machine": machine()}
            content = asdict(self) | {"ratios": ratios} | about
            path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        return path

    def _variants(self) -> list[str]:
        return [name for name in self.samples if name != BASELINE]


def compare(
    name: str, case: Case, variants: Mapping[str, Setup], pairs: int, steps: int | None = None,
    say: Say = silent, folder: Path | None = None,
) -> Comparison:  # fmt: skip
    """Run a case and its variants by turns, every other round backwards, so that a steady drift does not count.

    Args:
        pairs: number of rounds.
        steps: run only the first ones.
        say: takes a line after each run.
        folder: where the complete rounds are stored if a run fails.

    Raises:
        SolverError: a run failed; says which.
    """
    everything = {BASELINE: Setup(case), **variants}
    for one in everything.values():
        Domain.build(one.case.geometry)  # all find their mesh in the cache
    rounds: list[dict[str, Sample]] = []
    for number in range(pairs):
        found: dict[str, Sample] = {}
        for label in list(everything)[:: -1 if number % 2 else 1]:
            try:
                found[label] = run_sample(everything[label], steps)
            except SolverError as error:
                if folder and rounds:
                    _comparison(name, steps, case, everything, rounds).write(folder)
                raise SolverError(f"{name}, {label}, run {number + 1} of {pairs}: {error}") from error
            took = f"{found[label].seconds:.1f} s, {found[label].factorisations} factorisations"
            say(f"{name}, {label}, {number + 1} of {pairs}: {took}")
        rounds.append(found)
    return _comparison(name, steps, case, everything, rounds)


def _comparison(
    name: str, steps: int | None, case: Case, labels: Iterable[str], rounds: Sequence[Mapping[str, Sample]]
) -> Comparison:
    samples = {label: [found[label] for found in rounds] for label in labels}
    planned = case.time.steps
    return Comparison(name, min(steps or planned, planned), planned, samples)


def named(kind: Literal["CASES", "VARIANTS"], names: Sequence[str]) -> dict[str, Any]:
    """Return the named CASES or VARIANTS of the modules in `ngfsi.bench`; without names their SHORT cases, no variants.

    Raises:
        OutputError: a name is unknown.
    """
    modules = registry.everything("ngfsi.bench", "module with cases and variants").values()
    known = {name: one for module in modules for name, one in getattr(module, kind).items()}
    for name in names:
        if name not in known:
            raise OutputError(unknown("case" if kind == "CASES" else "variant", name, known))
    short = [name for module in modules for name in module.SHORT] if kind == "CASES" else []
    return {name: known[name] for name in names or short}
