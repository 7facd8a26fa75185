"""Which of K, stiffness of the wall and shape of the vein explains the losses of area that the source study measured?

    python -m ngfsi_studies.measured_veins FOLDER

A short piece of the calf at rest, in 3-D, under a pressure on the skin that rises to 40 mmHg in steps, for values of
the three within wide ranges (Box and Wilson's central composite design); a quadratic polynomial of their logarithms for
the logarithm of the area at each pressure, tested on further runs; and with that least squares with priors.
"""

from __future__ import annotations

import sys
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

from ngfsi.arrays import Array
from ngfsi.case import Case
from ngfsi.errors import NgfsiError, SolverError
from ngfsi.gradient.functionals import measured as quantity
from ngfsi.identify.least_squares import Fit, Unknown, check, fit
from ngfsi.linear.backends import choose_backend
from ngfsi.measure.deformation import Deformation
from ngfsi.mesh.domain import Domain
from ngfsi.report.tables import markdown_table
from ngfsi.solve.initial import initial_state
from ngfsi.solve.newton import Newton
from ngfsi.solve.time_loop import TimeLoop
from ngfsi.store.disk import replace_file
from ngfsi.store.table import read_rows, write_rows
from ngfsi.system.system import System
from ngfsi_studies.source import tables

CASE = Path(__file__).with_suffix(".toml")
NAMES = ("materials.tissue.K", "materials.wall.young", "geometry.aspect_ratio")
TITLES = ("K", "wall", "shape")
LOW, HIGH = np.array([10e3, 50e3, 1.0]), np.array([100e3, 350e3, 3.0])
MEAN, SD = np.array([28e3, 133e3, 1.7]), np.array([15e3, 60e3, 0.6])
"""Priors: the study's own values of K and of the wall; veins from round to nearly three times as wide as high. The
standard deviations are choices."""
ROUND = np.array([28e3, 133e3, 1.0])
"""What the study itself had in 3-D, with the mean of its K."""
STEPS = (10, 20, 25, 30, 40)
"""Pressures on the skin (mmHg) of which data may be."""
READING = 0.02
"""Standard error of a loss that a reader of the images makes: a choice."""


def designs() -> dict[str, Array]:
    """Return logarithms of the parameters by the name of the run; names of tests begin with t."""
    middle, half = np.log(HIGH * LOW) / 2, np.log(HIGH / LOW) / 2
    places = [*product((-1, 1), repeat=3), *(s * one for one in np.eye(3) for s in (-1, 1)), np.zeros(3)]
    tests = np.random.default_rng(1).uniform(-0.8, 0.8, (4, 3))
    return {f"{kind}{n:02}": middle + half * np.asarray(one)
            for kind, found in (("r", places), ("t", tests)) for n, one in enumerate(found)}  # fmt: skip


def terms(logs: Array) -> Array:
    """Return the terms of a quadratic polynomial."""
    x = (2 * logs - np.log(HIGH * LOW)) / np.log(HIGH / LOW)
    return np.array([1.0, *x, *x**2, x[0] * x[1], x[0] * x[2], x[1] * x[2]])


def computed(case: Case) -> dict[str, float | str]:
    """Return the area of the middle section under each pressure, as far as there is an equilibrium."""
    domain = Domain.build(case.geometry)
    system = System(case, domain)
    newton = Newton(system, choose_backend(case.solver.linear))
    initial_state(system, newton)
    area = quantity(system, "area_z05")
    times, areas = [0.0], [area.value()]
    loop = TimeLoop(case, system, newton, Deformation(system).inversion)
    try:
        for step in loop.run():
            times.append(step.time)
            areas.append(area.value())
    except SolverError as error:
        print(error)
    at = {f"area_{p}mmHg_m2": p / STEPS[-1] * case.time.end for p in (0, *STEPS)}
    return {name: float(np.interp(t, times, areas)) if t <= times[-1] + 1e-9 else np.nan for name, t in at.items()}


class Areas:
    """Area of the middle section (m2) by the logarithms of the parameters and the pressure on the skin.

    Attributes:
        errors: relative, of the tests, by pressure.
    """

    def __init__(self, folder: Path) -> None:
        """Compute the runs, or read them."""
        base, logs, table = Case.from_toml(CASE), designs(), folder / "areas.csv"
        rows = {str(row.pop("run")): row for row in read_rows(table)} if table.exists() else {}
        for key, one in logs.items():
            if key not in rows:
                case = base.replace(**dict(zip(NAMES, np.exp(one).tolist(), strict=True)))
                rows[key] = computed(case)
                write_rows(table, [{"run": name, **row} for name, row in rows.items()])
                print(key, *np.exp(one), *rows[key].values(), flush=True)
        self._factors, self.errors = {}, {}
        for pressure in (0, *STEPS):
            known = {key: float(row[f"area_{pressure}mmHg_m2"] or "nan") for key, row in rows.items()}
            done = [key for key, area in known.items() if np.isfinite(area)]
            fitted = [key for key in done if key[0] == "r"]
            matrix = np.array([terms(logs[key]) for key in fitted])
            self._factors[pressure] = np.linalg.lstsq(matrix, np.log([known[key] for key in fitted]))[0]
            gaps = [terms(logs[key]) @ self._factors[pressure] - np.log(known[key]) for key in done if key[0] == "t"]
            self.errors[pressure] = float(np.sqrt(np.mean(np.square(gaps))))

    def area(self, values: Array, pressure: int) -> float:
        """Return the area in m2 for parameters (SI)."""
        return float(np.exp(terms(np.log(values)) @ self._factors[pressure]))

    def loss(self, values: Array, pressure: int) -> float:
        """Return the fraction that is lost since there was no pressure on the skin."""
        return 1 - self.area(values, pressure) / self.area(values, 0)

    def losses(self, pressure: int, values: Array) -> Array:
        """Return it as data (1,)."""
        return np.array([self.loss(values, pressure)])

    def slopes(self, values: Array, pressure: int) -> Array:
        """Return the derivatives of the loss."""
        steps = 1e-5 * np.diag(values)
        return np.array([(self.loss(values + one, pressure) - self.loss(values - one, pressure)) / 2 / one.sum()
                         for one in steps])  # fmt: skip


def measured() -> tuple[Array, Array]:
    """Return loss and standard error of each subject: mean of four sections, and what they and the reader differ by."""
    losses = np.array(tables("calibration")["area_reduction_measured_percent"]) / 100
    return losses.mean(axis=1), np.hypot(READING, losses.std(axis=1, ddof=1) / np.sqrt(losses.shape[1]))


def alone(areas: Areas, place: int, loss: float, pressure: int) -> str:
    """Say which value of one parameter makes a loss, with the others as the study had them in 3-D."""
    tried = np.geomspace(LOW[place], HIGH[place], 400)
    found = [areas.loss(np.where(np.arange(3) == place, one, ROUND), pressure) for one in tried]
    best = int(np.argmax(found))
    if found[best] < loss:
        return f"none: {100 * found[best]:.0f} % at most, at {tried[best] / UNITS[place]:.3g}"
    return f"{tried[int(np.argmin(np.abs(np.array(found) - loss)))] / UNITS[place]:.3g}"


UNITS = np.array([1e3, 1e3, 1.0])
"""Of the numbers shown: kPa, kPa, 1."""


def fitted(areas: Areas, loss: float, error: float, pressure: int) -> Fit:
    """Return the three parameters by one loss and the priors."""
    unknowns = [Unknown(name, mean, low, high, mean, sd)
                for name, mean, low, high, sd in zip(TITLES, MEAN, LOW, HIGH, SD, strict=True)]  # fmt: skip
    return fit(unknowns, np.array([loss]), np.array([error]), partial(areas.losses, pressure),
               lambda x: areas.slopes(x, pressure)[None])  # fmt: skip


def further(areas: Areas, values: Array, error: float) -> dict[str, tuple[Array, Array]]:
    """Return relative standard deviations and correlations (K and wall, K and shape, wall and shape) by what is
    measured, without priors but for those of the first rows."""
    prior = np.diag(1 / SD**2)
    one = {p: np.outer(areas.slopes(values, p), areas.slopes(values, p)) / error**2 for p in STEPS}
    rest = np.array([np.log(areas.area(values + s, 0) / areas.area(values - s, 0)) / 2 / s.sum()
                     for s in 1e-5 * np.diag(values)])  # fmt: skip
    size, seen = np.outer(rest, rest) / 0.03**2, np.diag([0, 0, 1 / (0.05 * values[2]) ** 2])
    sets = {
        "priors alone": prior,
        "40 mmHg, one section": prior + one[40],
        "40 mmHg, sixteen sections": prior + 16 * one[40],
        "20 and 40 mmHg": prior + one[20] + one[40],
        "10, 20, 25, 30 and 40 mmHg": prior + sum(one.values()),
        "40 mmHg, aspect ratio to 5 %": prior + one[40] + seen,
        "five pressures, aspect ratio to 5 %": prior + sum(one.values()) + seen,
        "these, and the size without pressure to 3 %": prior + sum(one.values()) + seen + size,
    }
    found = {}
    for name, weights in sets.items():
        covariance = np.linalg.inv(weights)
        sd = np.sqrt(np.diag(covariance))
        correlation = covariance / np.outer(sd, sd)
        found[name] = sd / values, correlation[[0, 0, 1], [1, 2, 2]]
    return found


def main(folder: Path) -> None:
    """Compute, and write `report.md`."""
    areas, (losses, errors) = Areas(folder), measured()
    text = ["# What explains the measured areas\n", "Error of the polynomial in four more runs: " + ", ".join(
        f"{100 * error:.2g} % of the area at {p} mmHg" for p, error in areas.errors.items()) + ".\n"]  # fmt: skip
    for pressure in (25, 40):
        rows, single = [], []
        for n, (loss, error) in enumerate(zip(losses, errors, strict=True)):
            single.append(
                [f"{n + 1}", f"{100 * loss:.1f}", *(alone(areas, place, loss, pressure) for place in range(3))]
            )
            try:
                found = fitted(areas, loss, error, pressure)
            except NgfsiError as refused:
                rows.append([f"{n + 1}", f"{100 * loss:.1f} ± {100 * error:.1f}", str(refused), *[""] * 7])
                continue
            drawn = check(found, partial(areas.losses, pressure), 8)
            low, high = (np.clip(found.values + sign * found.half_width, LOW, HIGH) / UNITS for sign in (-1, 1))
            spans = [f"{a:.3g} to {b:.3g} ({by:+.1f})"
                     for a, b, by in zip(low, high, (found.values - MEAN) / SD, strict=True)]  # fmt: skip
            rows.append([f"{n + 1}", f"{100 * loss:.1f} ± {100 * error:.1f}", f"{100 * found.model[0]:.1f}", *spans,
                         *(f"{one:.2f}" for one in found.correlation[[0, 0, 1], [1, 2, 2]]),
                         f"{drawn.spread[0] / error:.1f} / {drawn.linear_spread[0] / error:.1f}"])  # fmt: skip
            if pressure == 40 and n == 0:
                sets = further(areas, found.values, error)
        text += [f"## {pressure} mmHg on the skin\n", "One parameter alone:\n",
                 markdown_table(["subject", "measured, %", "K [kPa]", "wall [kPa]", "aspect ratio"], single),
                 "All three: 95 % intervals; in brackets the move, in standard deviations of the prior:\n",
                 markdown_table(["subject", "measured, %", "fitted, %", "K [kPa]", "wall [kPa]", "aspect ratio",
                                 "K, wall", "K, shape", "wall, shape", "spread: runs / linear"], rows)]  # fmt: skip
    text += ["## What more would tell\n", markdown_table(
        ["measured", "K", "wall", "aspect ratio", "K, wall", "K, shape", "wall, shape"],
        [[name, *(f"{100 * one:.0f} %" for one in sd), *(f"{one:.2f}" for one in correlation)]
         for name, (sd, correlation) in sets.items()])]  # fmt: skip
    replace_file(folder / "report.md", "\n".join(text).encode())
    print("\n".join(text))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
