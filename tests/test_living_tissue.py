"""The study of living tissue: what its tissues are, and what its page says of runs that are known."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_studies.living_tissue import (
    ALONG,
    LEVELS,
    LOSS,
    PERIOD,
    TISSUES,
    VISCOSITIES,
    at_rest,
    in_time,
    reinforced,
    same_mean,
    viscosity,
    write_report,
)
from ngsolve.meshes import MakeStructured3DMesh

from ngfsi.materials.solid.fibres import Fibred
from ngfsi.study import Outcome

CUBE = MakeStructured3DMesh(hexes=True, nx=1, ny=1, nz=1)


def energy(law: Any, F: Any) -> float:
    """Return the stored energy (J/m3) at a deformation gradient."""
    ways = [way.field(None, "") for way in law.fibres] if hasattr(law, "fibres") else []
    model = Fibred(law, ways) if ways else law
    return float(model.energy(ng.CF(tuple(np.ravel(F).tolist()), dims=(3, 3)))(CUBE(0.5, 0.5, 0.5)))


@pytest.mark.parametrize("name", TISSUES)
def test_without_fibres_it_has_the_moduli_of_the_tissue(name: str) -> None:
    """Of N it is the same energy at any strain; of M that of small ones, in shear and dilation."""
    tissue, plain = TISSUES[name], reinforced(TISSUES[name], 3.0)
    F = np.array([[1.1, 0.2, -0.05], [-0.1, 0.95, 0.15], [0.05, 0.1, 1.2]])
    if name == "N":
        assert energy(plain, F) == pytest.approx(energy(tissue, F), rel=1e-12)
    small = np.eye(3) + 1e-3 * (F - np.eye(3))
    assert energy(plain, small) == pytest.approx(energy(tissue, small), rel=5e-3)


def test_fibres_have_the_stiffness_that_is_published() -> None:
    """Along them a stretch l at constant volume stores ALONG G/2 (l - 1)^2; the mean of all shears is G where the
    factor says so."""
    tissue, e = TISSUES["M"], 1e-4
    G = tissue.shear_modulus
    law = reinforced(tissue, ALONG)
    a = np.array(law.fibres[0].vector)

    def stretched(direction: Any) -> Any:
        along = np.outer(direction, direction)
        return (1 + e) * along + (1 + e) ** -0.5 * (np.eye(3) - along)

    assert energy(law, stretched(a)) == pytest.approx(ALONG * G / 2 * e**2, rel=1e-3)
    rng, scaled, found = np.random.default_rng(3), reinforced(tissue, ALONG, same_mean(ALONG)), []
    for _ in range(2000):
        m, n = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
        shear = np.eye(3) + e / 2 * (np.outer(m, n) + np.outer(n, m))
        # of small strain: the energy of the fibres is c1 (a . e a)^2, that of the rest c3 e : e times 2
        found.append(scaled.c1 * (a @ (shear - np.eye(3)) @ a) ** 2 + scaled.c3 * e**2)
        if len(found) == 1:
            assert energy(scaled, shear) == pytest.approx(found[0], rel=5e-3)
    assert np.mean(found) == pytest.approx(G / 2 * e**2, rel=0.02)


@pytest.mark.parametrize("kind", VISCOSITIES[1:])
def test_the_loss_angle_is_that_of_muscle(kind: str) -> None:
    """Loss over storage modulus at the period of the swing, the law's own modulus included."""
    G, rate = 7e3, 2 * np.pi / PERIOD
    found = viscosity(kind, G)
    assert found is not None
    x = rate * np.array(found.times)
    moduli = np.array(found.moduli)
    storage = G + np.sum(moduli * x**2 / (1 + x**2))
    lost = np.sum(moduli * x / (1 + x**2)) + found.kelvin_voigt * rate
    assert lost / storage == pytest.approx(LOSS, rel=1e-12)
    assert pytest.approx(np.tan(0.253 * np.pi / 2), rel=1e-12) == LOSS


def test_cases() -> None:
    level = LEVELS["paper"]
    cases = at_rest(level) | in_time(level)
    assert len({one.digest for one in cases.values()}) == len(cases) == 2 * 2 * 6 + 5 + 6 + 2
    assert all(key == one.name or key.startswith(one.name) for key, one in cases.items())
    sheets = cases["n-oval-sheets"]
    assert {one.on for one in sheets.materials.membranes} == {"skin", "fascia", "interosseous_membrane"}
    assert sheets.materials.law_of("lateral") == TISSUES["N"]
    assert sheets.materials.law_of("fat").label == "fat_likely"


def known(loss: float, rise: float) -> Any:
    times = np.arange(101) * 0.01
    series = {"time_s": times, "lumen_volume_m3": 1 - loss * times, "sawss_Pa": 1 + (rise - 1) * times}
    return SimpleNamespace(series=series)


def test_the_report(tmp_path: Path) -> None:
    losses = {"isotropic": 0.2, "plain": 0.24, "fibres": 0.192, "mean": 0.288, "fat": 0.22, "sheets": 0.16}
    runs = {f"m-round-{kind}": known(loss, 1.5) for kind, loss in losses.items()}
    runs |= {f"m-linear-{kind}": known(0.2, 2.0) for kind in VISCOSITIES}
    runs |= {"m-round-isotropic-space": known(0.21, 1.5), "m-linear-elastic-space": known(0.2, 2.1),
             "m-linear-elastic-time": known(0.2, 1.8)}  # fmt: skip
    outcomes = {key: Outcome(run) for key, run in runs.items()} | {"m-smooth-elastic": Outcome(None, "no mesh")}
    text = write_report("paper", tmp_path, outcomes).read_text(encoding="utf-8")
    assert "- **M, round vein**: it loses 20 ± 1 % of its volume, 24 ± 1 % with the polynomial" in text
    assert "change the loss by -20.0 % of itself, fibres at the same mean shear modulus by +20.0 %" in text
    runs |= {"m-round-fibres-space": known(0.2, 1.5), "m-round-plain-space": known(0.245, 1.5)}
    outcomes |= {key: Outcome(run) for key, run in runs.items()}
    # 0.8 - 1 against 0.2/0.245 - 1 among companions
    again = write_report("paper", tmp_path, outcomes).read_text(encoding="utf-8")
    assert "change the loss by -20 ± 2 % of itself, fibres at the same mean" in again
    assert "with fat it loses 22 ± 1 %; with fat, skin and fasciae 16.0 ± 0.8 %" in text
    assert "fibres make the calf stiffer, by up to 20 % of the loss; if they are a mean over directions, softer" in text
    assert "SAWSS swings by 0.0 % of that at t = 0 with elastic tissue" in text
    assert "| linear | elastic | 20" in text
    assert "| 2.0 ± 0.3 |" in text
    assert "- m-smooth-elastic: no mesh" in text
    assert (tmp_path / "at_rest.csv").read_text().count("\n") == 1 + len(losses)
