"""Discretisation, time, solver and output."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import ngsolve as ng
import numpy as np
import pytest

from ngfsi.case import Case
from ngfsi.case.formats import FORMAT
from ngfsi.config import functions as curves
from ngfsi.errors import CaseError, SolverError
from ngfsi.linear.backends import choose_backend
from ngfsi.run.computation import run
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.store.checkpoint import Checkpoints
from ngfsi.store.stored import StoredRun
from ngfsi.system.system import System
from tests.settings.physics import measured
from tests.settings.table import Outcome, entry
from tests.vein import BONED, TISSUE, TUBE, case_of, rows, set_motion, steady, system_of


@entry("Discretisation.order")
def _order() -> Outcome:
    """Unknowns of a tube of prisms and tetrahedra by Euler's formula are too many to count by hand: they grow."""
    sizes = [system_of(case_of(TUBE, **{"discretisation.order": k})).unknowns.size for k in (2, 3)]
    return 2 < sizes[1] / sizes[0] < (3 / 2) ** 3 * 1.2, True


@entry("Discretisation.mesh_motion")
def _mesh_motion() -> Outcome:
    """Another mesh inside of the lumen, the same lumen."""
    skin = curves.PressureConstant(value=2000.0)
    there = [
        [
            measured(column, loads__skin_pressure=skin, discretisation__mesh_motion=motion)
            for motion in ("harmonic", "elastic")
        ]
        for column in ("lumen_volume_m3", "detF_min_fluid_1")
    ]
    changes = [abs(b / a - 1) for a, b in there]
    return [changes[0] < 1e-7, changes[1] > 1e-5], [True, True]


@entry("Discretisation.bulk_integration")
def _bulk_integration() -> Outcome:
    """Nearly incompressible solids lock at full integration: they give way less, here around a cavity."""
    tissue, skin = TISSUE.replace(poisson=0.49999), curves.PressureConstant(value=2000.0)
    moved = [
        measured(
            "displacement_max_m",
            materials__tissue=tissue,
            loads__skin_pressure=skin,
            discretisation__bulk_integration=by,
        )
        for by in ("full", "reduced")
    ]
    return abs(moved[1] / moved[0] - 1) > 1e-2, True


@entry("Discretisation.extension_stiffness")
def _extension_stiffness() -> Outcome:
    """Ten times the residual of the mesh's equation."""
    found = []
    for stiffness in (1.0, 10.0):
        system = system_of(case_of(TUBE, **{"discretisation.extension_stiffness": stiffness}))
        set_motion(system, 1e-3 * ng.CF((ng.x * ng.z / 1e-2, 0, 0)))
        found.append(rows(system, "e", system.apply().copy()))
    return found[1], 10 * found[0]


@entry("Discretisation.extra_integration_order")
def _extra_integration_order() -> Outcome:
    """Rules that are exact for polynomials of so many orders more."""
    found = []
    for extra in (0, 3):
        rule = system_of(case_of(TUBE, **{"discretisation.extra_integration_order": extra}))._rules()[ng.ET.TRIG]
        pairs = list(zip(rule.points, rule.weights, strict=True))
        found.append(
            [abs(sum(w * p[0] ** power for p, w in pairs) * (power + 1) * (power + 2) - 1) < 1e-12 for power in (4, 7)]
        )
    return found, [[True, False], [True, True]]


def steps_of(**changes: Any) -> tuple[System, list[Any]]:
    """Return the system of a squeezed vein after its steps, and these."""
    ramp = curves.PressureRamp(final=300.0, duration=1.0)
    case = case_of(BONED, **{"loads.skin_pressure": ramp, "time.step": 0.1, "time.end": 0.3, **changes})
    system, newton = steady(case)
    return system, list(TimeLoop(case, system, newton).run())


@entry("TimeStepping.step", "TimeStepping.end")
def _steps() -> Outcome:
    case = case_of(**{"time.step": 0.1, "time.end": 0.45})
    loop = TimeLoop(case, system_of(case), None)  # type: ignore[arg-type]
    return [len(loop.milestones), loop.milestones[-1]], [5, 0.45]


@entry("TimeStepping.scheme", rel=1e-12)
def _scheme() -> Outcome:
    """Weight of the new state in its rate: 1/h, 3/(2 h) from the second step on, 0 at rest; in stages 1/(gamma h), with
    the middle root of g^3 - 3 g^2 + 3/2 g = 1/6, and 1/4."""
    schemes = ("backward_euler", "bdf2", "static", "esdirk3", "sdirk4")
    weights = [steps_of(**{"time.scheme": scheme})[0].new_weight.Get() for scheme in schemes]
    return weights, [10.0, 15.0, 0.0, 10 / sorted(np.roots([1.0, -3.0, 1.5, -1 / 6]))[1], 40.0]


@entry("TimeStepping.smallest_step")
def _smallest_step() -> Outcome:
    """No state is accepted: steps are halved so often, and one more is tried before the run ends."""
    tried = []
    for smallest in (0.1, 0.1 / 4):
        case = case_of(BONED, **{"time.step": 0.1, "time.end": 0.3, "time.smallest_step": smallest})
        system, newton = steady(case)
        count = 0

        def refuse() -> str:
            nonlocal count
            count += 1
            return "not accepted"

        with pytest.raises(SolverError):
            list(TimeLoop(case, system, newton, refuse).run())
        tried.append(count)
    return tried, [1, 3]


@entry("TimeStepping.error_tolerance")
def _error_tolerance() -> Outcome:
    sizes = [len(steps_of(**{"time.error_tolerance": tolerance})[1]) for tolerance in (0.5, 5e-3)]
    return sizes[0] == 3 < sizes[1], True


@entry("Solver.tolerance")
def _tolerance() -> Outcome:
    loose, tight = (
        sum(step.solution.iterations for step in steps_of(**{"solver.tolerance": tolerance})[1])
        for tolerance in (1e-3, 1e-9)
    )
    return loose < tight, True


@entry("Solver.max_iterations")
def _max_iterations() -> Outcome:
    with pytest.raises(SolverError, match="1 iteration"):
        steps_of(**{"solver.max_iterations": 1, "time.smallest_step": 0.1})
    return True, True


@entry("Solver.linearise")
def _linearise() -> Outcome:
    """A factorisation for each iteration, or fewer."""
    counts = []
    for linearise in ("always", "when slow"):
        steps = steps_of(**{"solver.linearise": linearise})[1]
        counts.append(
            [sum(getattr(step.solution, what) for step in steps) for what in ("iterations", "factorisations")]
        )
    always, when_slow = counts
    return [always[0] == always[1], when_slow[1] < when_slow[0] / 2], [True, True]


@entry("Solver.linear", rel=1e-8)
def _linear_solver() -> Outcome:
    assert choose_backend("umfpack") == "umfpack"
    volume = measured("lumen_volume_m3", solver__linear="umfpack")
    return volume, measured("lumen_volume_m3")


OUTPUT: dict[str, Any] = {
    "time.step": 0.1, "time.end": 0.4, "output.fields_every": 2, "output.wall_every": 4, "output.stations": 5,
    "output.checkpoint_every": 0, "output.stability": True,
}  # fmt: skip


@cache
def stored() -> tuple[StoredRun, TemporaryDirectory[str]]:
    """Return a run with other settings than usual, in a folder that lasts as long as it."""
    folder = TemporaryDirectory()
    return run(case_of(BONED, **OUTPUT), Path(folder.name) / "run", quiet=True), folder


@entry("Output.fields_every", "Output.wall_every", "Output.stations", rel=1e-12)
def _what_is_written() -> Outcome:
    done = stored()[0]
    found = [*done.field_times("volume"), *done.field_times("wall"), len(done.outlines(0.0)[1])]
    return found, [0.0, 0.2, 0.4, 0.0, 0.4, 5]


@entry("Output.stability")
def _stability() -> Outcome:
    return list(stored()[0].stability["time_s"]), pytest.approx([0.0, 0.2, 0.4])


@entry("Output.low_shear")
def _low_shear() -> Outcome:
    """All of the wall below a stress beyond the largest, nothing below one under the smallest."""
    areas = [measured("wss_low_area_1", output__low_shear=threshold) for threshold in (1e3, 1e-9)]
    return areas, pytest.approx([1.0, 0.0])


def checkpoints(**changes: Any) -> list[float]:
    """Return the times at which a run writes checkpoints."""
    written: list[float] = []
    write = Checkpoints.write

    def noted(self: Checkpoints, *args: Any, **facts: Any) -> None:
        written.append(facts["time_s"])
        write(self, *args, **facts)

    case = case_of(BONED, **{**OUTPUT, "output.stability": False, "time.end": 0.2, **changes})
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(Checkpoints, "write", noted)
        run(case, Path(folder) / "run", quiet=True)
    return written


@entry("Output.checkpoint_every", "Output.checkpoint_interval")
def _checkpoints() -> Outcome:
    """At the start, and by the number of steps or by the clock."""
    every = checkpoints(**{"output.checkpoint_every": 2}), checkpoints(**{"output.checkpoint_interval": 1e-9})
    return [len(checkpoints()), *map(len, every)], [1, 2, 3]


@entry("Case.format")
def _format() -> Outcome:
    """A file that names no format is of the present one; others are refused (tests/test_formats.py)."""
    without = {key: value for key, value in case_of(BONED).to_toml_dict().items() if key != "format"}
    newer = f"{int(FORMAT.partition('.')[0]) + 1}.0"
    try:
        Case.from_dict({**without, "format": newer})
    except CaseError as error:
        return [Case.from_dict(without).format, newer in str(error)], [FORMAT, True]
    return "accepted", "refused"


@entry("Case.name")
def _name() -> Outcome:
    """It is how progress and comparisons call the run, and changes no result."""
    case = case_of(BONED)
    return [case.replace(name="other").digest == case.digest, stored()[0].case.name], [True, "test"]
