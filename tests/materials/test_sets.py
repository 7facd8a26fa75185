"""The shipped parameter sets hold the printed numbers, and the table says what is odd about them."""

from __future__ import annotations

import math
from typing import Any

import pytest

from ngfsi.errors import MaterialError
from ngfsi.materials import (
    CompressibleNeoHookean,
    MooneyRivlin,
    NeoHookean,
    Newtonian,
    Ogden,
    SaintVenantKirchhoff,
    available_sets,
    load_set,
)
from ngfsi.materials.parameter_sets import read_set
from ngfsi.materials.solid.blemker import Blemker
from ngfsi.materials.solid.holzapfel_gasser_ogden import HolzapfelGasserOgden

# (c10, c01, c11, K) in Pa: thesis chapter 4, K of subjects 1-4; the review's table 2 with K of subject 1 over ten
MOONEY_RIVLIN = {
    "mooney_rivlin_s1": (13100.0, -9610.0, 8860.0, 28450.0),
    "mooney_rivlin_s2": (13100.0, -9610.0, 8860.0, 22690.0),
    "mooney_rivlin_s3": (13100.0, -9610.0, 8860.0, 22930.0),
    "mooney_rivlin_s4": (13100.0, -9610.0, 8860.0, 35410.0),
    "mooney_rivlin_tenth": (1310.0, -961.0, 886.0, 2845.0),
}
# (C10, Kv) in Pa and the initial bulk modulus that follows
NEO_HOOKEAN = {
    "neo_hookean_printed": (89600.0, 69500.0, 139000.0),
    "neo_hookean_printed_named": (89600.0, 69500.0, 69500.0),
    "neo_hookean_likely": (11500.0, 71900.0, 71900.0),
    "fat_likely": (3300.0, 89600.0, 89600.0),
}
# by test_fluids.py, from the formulas
THINNING = {"blood_carreau", "blood_carreau_yasuda", "blood_carreau_yasuda_boyd", "blood_analogue", "blood_cross",
            "blood_casson", "blood_quemada"}  # fmt: skip


def test_nothing_ships_unchecked() -> None:
    others = {
        "vein_wall",
        "vein_wall_source",
        "loose_connective_tissue",
        "blood",
        "muscle_blemker",
        "muscle_bosboom",
        "muscle_palevski",
        "adventitia",
        "skin",
        "crural_fascia",
        *THINNING,
    }
    assert set(available_sets()) == {*MOONEY_RIVLIN, *NEO_HOOKEAN, *others}


@pytest.mark.parametrize("name", MOONEY_RIVLIN)
def test_mooney_rivlin_sets(name: str) -> None:
    law = load_set(name)
    assert isinstance(law, MooneyRivlin)
    assert (law.c10, law.c01, law.c11, law.K) == MOONEY_RIVLIN[name]
    assert law.label == name


@pytest.mark.parametrize("name", NEO_HOOKEAN)
def test_neo_hookean_sets(name: str) -> None:
    law = load_set(name)
    assert isinstance(law, NeoHookean)
    assert (law.C10, law.Kv, law.bulk_modulus) == NEO_HOOKEAN[name]


def test_wall_and_blood() -> None:
    laws = {"vein_wall": CompressibleNeoHookean, "vein_wall_source": SaintVenantKirchhoff}
    for name, law in laws.items():
        wall = load_set(name)
        assert isinstance(wall, law)
        assert (wall.young, wall.poisson, wall.density) == (133e3, 0.49, 1060.0)
    blood = load_set("blood")
    assert isinstance(blood, Newtonian)
    assert (blood.density, blood.viscosity) == (1060.0, 0.0035)


def test_viscoelastic_muscle() -> None:
    """At once and in the long run the shear moduli are those printed."""
    for name, at_once, rest, alpha in (("muscle_bosboom", 15.6e3, 0.451 * 15.6e3, 21.4),
                                       ("muscle_palevski", 5711.0, 807.0, 2.0)):  # fmt: skip
        law = load_set(name)
        assert isinstance(law, Ogden)
        assert law.viscosity is not None
        assert law.shear_modulus == pytest.approx(rest, rel=1e-12)
        assert law.shear_modulus + sum(law.viscosity.moduli) == pytest.approx(at_once, rel=1e-12)
        assert law.alpha == (alpha,)
        assert law.poissons_ratio == pytest.approx(0.49, abs=2e-4)
    (tau,) = load_set("muscle_bosboom").viscosity.times
    assert tau == 6.01
    (tau,) = load_set("muscle_palevski").viscosity.times
    # 20 s after, 10 % above the plateau
    assert 4904 * math.exp(-20 / tau) == pytest.approx(80.7, rel=5e-3)


def test_fibres() -> None:
    wall = load_set("adventitia")
    assert isinstance(wall, HolzapfelGasserOgden)
    assert (wall.c, wall.k1, wall.k2, wall.kappa) == (7640.0, 996.6e3, 524.6, 0.226)
    assert [math.degrees(one.angle) for one in wall.fibres] == pytest.approx([49.98, -49.98], rel=1e-12)
    muscle = load_set("muscle_blemker")
    assert isinstance(muscle, Blemker)
    constants = (muscle.G1, muscle.G2, muscle.P1, muscle.P2, muscle.peak_stress, muscle.optimal_stretch, muscle.K)
    assert constants == (500.0, 500.0, 0.05, 6.6, 300e3, 1.07, 1e6)
    assert muscle.straight_stretch * muscle.optimal_stretch == pytest.approx(1.4, rel=1e-12)
    # the fascia's bundles have 4 k1 along them at rest
    assert load_set("crural_fascia").k1 * 4 == 40e6


@pytest.mark.parametrize("name", available_sets())
def test_every_set_says_where_it_comes_from(name: str) -> None:
    entry = read_set(name)
    for text in (entry.title, entry.source, entry.remark):
        assert len(text) > 10
        assert "\n" not in text


def test_changes_in_si_or_with_a_unit() -> None:
    assert load_set("mooney_rivlin_s1", K=30e3).K == load_set("mooney_rivlin_s1", K_kPa=30).K == 30e3
    assert load_set("mooney_rivlin_s1", K_kPa=30).label == "mooney_rivlin_s1 (K_kPa=30)"
    assert load_set("mooney_rivlin_s1", K_kPa=30, label="stiffer").label == "stiffer"
    assert load_set("mooney_rivlin_s1").K == 28450.0  # the set itself is untouched


def test_unknown_set_and_refused_change() -> None:
    with pytest.raises(MaterialError, match="did you mean 'mooney_rivlin_s1'"):
        load_set("mooney_rivlin_1")
    with pytest.raises(MaterialError, match=r"^K_kPa = -1 is not accepted: a number greater than 0 is wanted$"):
        load_set("mooney_rivlin_s1", K_kPa=-1)
    with pytest.raises(MaterialError, match="'C10_kPa' is not a known key: did you mean 'c10_kPa'"):
        load_set("mooney_rivlin_s1", C10_kPa=1)


def test_initial_moduli_and_flags() -> None:
    sets = {name: read_set(name) for name in available_sets()}
    laws: dict[str, Any] = {name: entry.material for name, entry in sets.items()}

    m = laws["mooney_rivlin_s1"]
    assert (m.shear_modulus, m.bulk_modulus) == pytest.approx((6980.0, 28450.0), rel=1e-13)
    assert m.youngs_modulus == pytest.approx(19356.97, rel=1e-6)
    assert m.poissons_ratio == pytest.approx(0.386602, rel=1e-5)
    assert laws["neo_hookean_printed_named"].poissons_ratio == pytest.approx(-0.19332, rel=1e-4)
    assert laws["neo_hookean_printed"].poissons_ratio == pytest.approx(0.04914, rel=1e-3)
    assert laws["neo_hookean_likely"].poissons_ratio == pytest.approx(0.35547, rel=1e-4)
    assert laws["blood"].nominal_viscosity == 0.0035
    assert {name: entry.flags for name, entry in sets.items() if entry.flags} == {
        "neo_hookean_printed_named": ("negative Poisson ratio",),
        "neo_hookean_printed": ("stated bulk modulus 69.5 kPa is not the initial bulk modulus 139 kPa",),
    }
