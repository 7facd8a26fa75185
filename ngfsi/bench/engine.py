"""Benchmarks of speed: whole runs as processes of their own, by turns, so that both meet the same moods of the machine.

What counts are ratios to the baseline; seconds, which are stored beside, are of one machine on one day. The named
cases and variants are in modules registered in the group `ngfsi.bench`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
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
from ngfsi.store.disk import replace_file
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
        more = threads(setup.threads) if setup.threads else None
        child = process.call("ngfsi.study.engine:main", file, target, more=more)
        seconds = perf_counter() - started
        if child.returncode:
            raise SolverError(process.last_line(child.stderr))
        stored = open_run(target)
        manifest, costs = stored.manifest, stored.costs
        results = _results(stored)
    phases = {str(name): float(value) for name, value in manifest["seconds"].items()}
    phases[OUTSIDE] = seconds - sum(phases.values())
    return Sample(
        seconds=seconds,
        memory=float(manifest["peak_memory_MB"]),
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
    """Samples of so many steps of those planned, taken by turns; by variant, of which the first is the baseline."""

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
        ratios = {name: {q: self.ratios(name, q) for q in QUANTITIES} for name in self._variants()}
        about = {"versions": versions(), "commit": commit(), "machine": machine()}
        replace_file(path, (json.dumps(asdict(self) | {"ratios": ratios} | about, indent=1) + "\n").encode())
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
        folder: where the complete rounds are stored if a run fails.

    Raises:
        SolverError: a run failed; says which.
    """
    setups = {BASELINE: Setup(case), **variants}
    for one in setups.values():
        Domain.build(one.case.geometry)  # all find their mesh in the cache
    samples: dict[str, list[Sample]] = {label: [] for label in setups}
    planned = case.time.steps
    found = Comparison(name, min(steps or planned, planned), planned, samples)
    for number in range(pairs):
        taken: dict[str, Sample] = {}
        for label in list(setups)[:: -1 if number % 2 else 1]:
            try:
                taken[label] = run_sample(setups[label], steps)
            except SolverError as error:
                if folder and number:
                    found.write(folder)
                raise SolverError(f"{name}, {label}, run {number + 1} of {pairs}: {error}") from error
            took = f"{taken[label].seconds:.1f} s, {taken[label].factorisations} factorisations"
            say(f"{name}, {label}, {number + 1} of {pairs}: {took}")
        for label, sample in taken.items():
            samples[label].append(sample)
    return found


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
