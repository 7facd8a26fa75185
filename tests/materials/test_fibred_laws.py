"""Laws with fibres against closed forms, their directions against fields known by hand, and their ellipticity."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import ngsolve as ng
import numpy as np
import pytest

from ngfsi.errors import MaterialError
from ngfsi.materials import NeoHookean, load_set
from ngfsi.materials.solid.blemker import Blemker
from ngfsi.materials.solid.directions import AlongCurve, AlongHarmonic, AroundVessel, ConstantDirection, FromVtu
from ngfsi.materials.solid.fibres import Fibred, FibreLaw
from ngfsi.materials.solid.holzapfel_gasser_ogden import HolzapfelGasserOgden
from ngfsi.materials.solid.humphrey_yin import HumphreyYin
from ngfsi.measure.deformation import Deformation
from ngfsi.measure.ellipticity import Ellipticity, EllipticityInAllDirections
from ngfsi.registry import everything
from tests.materials.test_laws import Array, I, Numeric, deformations, difference, rotation, unit
from tests.vein import TUBE, case_of, domain_of, set_motion, system_of

Z = ConstantDirection(vector=(0.0, 0.0, 2.0))
K = 80e3
WALL = HolzapfelGasserOgden(fibres=(Z, Z), K=K, c=9e3, k1=7e3, k2=2.3, kappa=0.1, density=1060.0)
MUSCLE = Blemker(fibres=(Z,), K=K, G1=5e3, G2=3e3, P1=0.05, P2=6.6, peak_stress=300e3, straight_stretch=1.25,
                 optimal_stretch=0.95, density=1060.0)  # fmt: skip
HEART = HumphreyYin(fibres=(Z,), K=K, c1=8e3, c2=20e3, c3=3e3, c4=-4e3, c5=9e3, density=1060.0)
LAWS: list[FibreLaw] = [WALL, MUSCLE, HEART]
each_law = pytest.mark.parametrize("law", LAWS, ids=lambda law: law.law)


def slopes(law: FibreLaw, I1: float, I4: float, I5: float) -> tuple[float, float, float]:
    """Return the derivatives of the distortion of one family by its invariants, by hand."""
    l = np.sqrt(I4)  # noqa: E741
    if isinstance(law, HolzapfelGasserOgden):
        E = max(law.kappa * (I1 - 3) + (1 - 3 * law.kappa) * (I4 - 1), 0.0)
        pull = law.k1 * E * np.exp(law.k2 * E**2)
        return law.kappa * pull, (1 - 3 * law.kappa) * pull, 0.0
    if isinstance(law, HumphreyYin):
        c4 = (2 * law.c1 * (l - 1) + 3 * law.c2 * (l - 1) ** 2 + law.c4 * (I1 - 3)) / (2 * l)
        return law.c3 + law.c4 * (l - 1) + 2 * law.c5 * (I1 - 3), c4, 0.0
    assert isinstance(law, Blemker)
    x, end = l / law.optimal_stretch, law.straight_stretch
    pull = 0.0 if x < 1 else law.P1 * (np.exp(law.P2 * (min(x, end) - 1)) - 1)
    pull += law.P1 * law.P2 * np.exp(law.P2 * (end - 1)) * max(x - end, 0.0)
    cosh = (I1 * I4 - I5) / (2 * l)
    B2 = np.arccosh(max(cosh, 1.0))
    by = law.G2 * (2 * B2 / np.sinh(B2) if B2 > 1e-6 else 2.0)
    fibre = law.peak_stress * pull / (law.optimal_stretch * 2 * l)
    by_I4 = by * (I1 / (4 * l) + I5 / (4 * l**3)) - 2 * law.G1 * I5 / I4**3 + fibre
    return by * l / 2, by_I4, law.G1 / I4**2 - by / (2 * l)


def cauchy(law: FibreLaw, F: Array, ways: list[Array]) -> Array:
    """2/J dev(W1 B + W4 a a + W5 (a Ba + Ba a)) + K/2 (J - 1/J) I of the isochoric part of F."""
    J = np.linalg.det(F)
    bar = J ** (-1 / 3) * F
    B, whole = bar @ bar.T, np.zeros((3, 3))
    for way in ways:
        a = bar @ way
        I1, I4, I5 = np.trace(B), a @ a, a @ B @ a
        W1, W4, W5 = slopes(law, I1, I4, I5)
        whole += W1 * B + W4 * np.outer(a, a) + W5 * (np.outer(a, B @ a) + np.outer(B @ a, a))
    if isinstance(law, HolzapfelGasserOgden):
        whole += law.c / 2 * B
    whole = 2 / J * whole
    return whole - np.trace(whole) / 3 * I + law.K / 2 * (J - 1 / J) * I


def ways_of(law: FibreLaw, degrees: float) -> list[Array]:
    """Return unit vectors in the plane xy, at an angle to x; a second family at the opposite one."""
    turns = np.radians([degrees, -degrees])[: len(law.fibres)]
    return [np.array([np.cos(t), np.sin(t), 0.0]) for t in turns]


@cache
def numeric(law: FibreLaw, degrees: float) -> Numeric:
    return Numeric(Fibred(law, [ng.CF(tuple(way.tolist())) for way in ways_of(law, degrees)]))  # type: ignore[arg-type]


def test_the_battery_covers_every_law() -> None:
    laws = everything("ngfsi.solid_laws", "law").values()
    known = {law for law in laws if issubclass(law, FibreLaw) and law.__module__.startswith("ngfsi.")}
    assert {type(law) for law in LAWS} == known


@each_law
@pytest.mark.parametrize("degrees", [0, 45, 90])
def test_homogeneous_states(law: FibreLaw, degrees: float) -> None:
    """Stretch along x, simple shear, and any other deformation: stresses by hand."""
    scale = np.abs(numeric(law, degrees).cauchy(np.diag([1.3, 1.3**-0.5, 1.3**-0.5]))).max()
    states = [np.diag([x, x**-0.5, x**-0.5]) for x in (0.8, 1.15, 1.4)]
    for F in [*states, I + 0.4 * unit(0, 1), I + 0.4 * unit(2, 0), *deformations(2, 0.8, 1.3)]:
        found, exact = numeric(law, degrees).cauchy(F), cauchy(law, F, ways_of(law, degrees))
        assert np.abs(found - exact).max() < 1e-10 * max(scale, np.abs(exact).max())
    if len(law.fibres) == 1:  # stretched at 45 degrees, fibres that stiffen turn: it takes a shear stress to hold them
        assert (abs(numeric(law, degrees).cauchy(states[2])[0, 1]) > 1e-2 * scale) == (degrees == 45)


@each_law
def test_rest_objectivity_and_rotation_of_all(law: FibreLaw) -> None:
    rng = np.random.default_rng(2)
    W = numeric(law, 30)
    slack = law.replace(optimal_stretch=1.0) if isinstance(law, Blemker) else law
    assert np.abs(numeric(slack, 30).stress(I)).max() < 1e-10 * K
    Q = rotation(rng)
    for F in deformations(3, 0.8, 1.3):
        assert W.energy(Q @ F) == pytest.approx(W.energy(F), rel=1e-11)
    about_z = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    if len(law.fibres) == 1:
        for F in deformations(2, 0.8, 1.3):  # turned by 90 degrees together with the fibres
            turned = numeric(law, 120).energy(F @ about_z.T)
            assert turned == pytest.approx(W.energy(F), rel=1e-11)
            assert abs(W.energy(F @ about_z.T) / turned - 1) > 1e-3


@each_law
def test_stress_and_tangent_against_differences(law: FibreLaw) -> None:
    rng, W = np.random.default_rng(3), numeric(law, 30)
    for F in deformations(3, 0.8, 1.3):
        H = rng.standard_normal((3, 3))
        assert difference(W.energy, F, H) == pytest.approx(np.sum(W.stress(F) * H), rel=1e-6)
        dP = W.stress_rate(F, H)
        assert np.abs(difference(W.stress, F, H) - dP).max() < 1e-6 * np.abs(dP).max()


# ---------------------------------------------------------------- ellipticity


def test_ellipticity_in_all_directions_is_that_of_principal_planes_for_an_isotropic_law() -> None:
    law = HolzapfelGasserOgden(fibres=(Z,), K=K, c=9e3, k1=0.0, k2=1.0, density=1060.0)
    same = NeoHookean(C10=4.5e3, Kv=K, volumetric="K=Kv", density=1060.0)
    rng = np.random.default_rng(4)
    stretches = np.sort([[0.4, 1.0, 1.2], [0.9, 1.0, 1.1], [0.5, 0.6, 2.0], [0.3, 0.35, 0.5]], axis=1)
    F = np.array([rotation(rng) @ np.diag(one) @ rotation(rng) for one in stretches])
    found = EllipticityInAllDirections(law).smallest(F, np.tile([0.0, 0.0, 1.0], (len(F), 1, 1)))
    exact = Ellipticity(same).smallest(stretches) * same.shear_modulus / (9e3)
    np.testing.assert_allclose(found, exact, rtol=2e-2)


def test_fibres_under_compression_lose_ellipticity() -> None:
    """Kinking: with n along compressed fibres and a across them a . Q a = 2 W1 + 2 W4, isochoric (J. Merodio, R. W.
    Ogden, Arch Mech 54, 2002): of c3 and c1 alone it is 0 at c3 = c1 (1 - l)/l, l = 0.75 for c3 = c1/3."""
    law = HumphreyYin(fibres=(Z,), K=1e3 * K, c1=9e3, c2=0.0, c3=3e3, c4=0.0, c5=0.0, density=1060.0)
    check, way, rng = EllipticityInAllDirections(law), np.array([0.0, 0.0, 1.0]), np.random.default_rng(5)
    for stretch, stable in ((0.77, True), (0.73, False)):
        Q = rotation(rng)
        F = np.diag([stretch**-0.5, stretch**-0.5, stretch]) @ Q.T
        assert (check.smallest(F[None], (Q @ way)[None, None])[0] > 0) == stable


def test_a_run_is_told() -> None:
    """A tube whose fibres along z are compressed by half."""
    law = HEART.replace(c2=0.0, c4=0.0, c5=0.0, c1=9e3, c3=1e3)
    system = system_of(case_of(TUBE, **{"materials.tissue": law}))
    assert Deformation(system).unstable("tissue") == ""
    set_motion(system, ng.CF((0, 0, -0.5 * ng.z)))
    assert "lost strong ellipticity: humphrey_yin" in Deformation(system).unstable("tissue")


# ---------------------------------------------------------------- directions


def at(field: Any, *places: tuple[float, float, float]) -> Array:
    """Return the directions at points of a tube (n, 3), turned such that they point to where their sum does."""
    found = np.array([domain_of(TUBE).value(field, *place) for place in places])
    return found * np.sign(found @ np.ones(3))[:, None]


PLACES = [(8e-3, 2e-3, 3e-3), (-3e-3, 9e-3, 6e-3), (-5e-3, -9e-3, 1e-3)]


def around(place: tuple[float, float, float], angle: float = 0.0) -> Array:
    x, y, _ = place
    way = np.cos(angle) * np.array([-y, x, 0]) / np.hypot(x, y) + np.sin(angle) * np.array([0, 0, 1])
    return np.asarray(way * np.sign(way.sum()))


def test_constant_and_around_the_vessel() -> None:
    domain = domain_of(TUBE)
    np.testing.assert_allclose(at(Z.field(domain, "tissue"), PLACES[0]), [[0, 0, 1]])
    for angle in (0.0, 0.6):
        found = at(AroundVessel(angle=angle).field(domain, "tissue"), *PLACES)
        one, other = (np.array([around(p, sign * angle) for p in PLACES]) for sign in (1, -1))
        assert min(np.abs(found - one).max(), np.abs(found - other).max()) < 1e-9
    with pytest.raises(MaterialError, match="vessel for fibres around it"):
        AroundVessel(vessel="artery").field(domain, "tissue")


def test_along_a_curve() -> None:
    line = AlongCurve(points=((0.0, 0.0, 0.0), (3e-3, 4e-3, 0.0), (6e-3, 8e-3, 0.0)))
    np.testing.assert_allclose(at(line.field(domain_of(TUBE), "tissue"), *PLACES), [[0.6, 0.8, 0]] * 3, atol=1e-9)


def test_along_a_harmonic_field() -> None:
    """Between the ends it is z, from the wall to the skin ln r: along z, and along the radius."""
    domain = domain_of(TUBE)
    found = at(AlongHarmonic(start="tissue_bottom", end="tissue_top").field(domain, "tissue"), *PLACES)
    np.testing.assert_allclose(found, [[0, 0, 1]] * 3, atol=1e-9)


def test_from_a_vtu(tmp_path: Path) -> None:
    import pyvista

    grid = pyvista.ImageData(dimensions=(31, 31, 6), spacing=(1e-3, 1e-3, 2e-3), origin=(-15e-3, -15e-3, 0))
    grid = grid.cast_to_unstructured_grid()
    middles = grid.cell_centers().points
    grid.cell_data["fibres"] = 5 * np.stack([-middles[:, 1], middles[:, 0], 0 * middles[:, 0]], axis=1)
    grid.save(tmp_path / "fibres.vtu")
    domain = domain_of(TUBE)
    field = FromVtu(file=str(tmp_path / "fibres.vtu"), array="fibres").field(domain, "tissue")
    for element in list(domain.mesh.Elements())[::9]:
        x, y, z = np.mean([domain.mesh[v].point for v in element.vertices], axis=0)
        if np.hypot(x, y) > 5e-3:
            value = np.array(field(domain.mesh(x, y, z)))
            assert abs(value @ around((x, y, z))) > np.cos(0.12)
    with pytest.raises(MaterialError, match="did you mean 'fibres'"):
        FromVtu(file=str(tmp_path / "fibres.vtu"), array="fibre").field(domain, "tissue")
    with pytest.raises(MaterialError, match="cannot be read"):
        FromVtu(file=str(tmp_path / "none.vtu"), array="fibres").field(domain, "tissue")


# ---------------------------------------------------------------- in case files


def test_in_a_case_file() -> None:
    case = case_of(TUBE, **{
        "materials.tissue": {"set": "muscle_blemker"},
        "materials.wall": {"law": "holzapfel_gasser_ogden", "c_kPa": 9, "k1_kPa": 7, "k2": 2.3, "K_kPa": 80,
                           "density_kg_m3": 1060, "fibres": [{"kind": "around", "angle_deg": 40},
                                                             {"kind": "around", "angle_deg": -40}]},
    })  # fmt: skip
    again = type(case).from_dict(case.to_toml_dict())
    assert again == case
    system = system_of(again)
    model = system.solids["wall"]
    assert isinstance(model, Fibred)
    assert len(model.directions) == 2
    assert np.isfinite(np.asarray(system.apply())).all()


def test_refusals() -> None:
    with pytest.raises(MaterialError, match="must be bound"):
        MUSCLE.energy(ng.Id(3))
    two = MUSCLE.replace(fibres=(Z, Z))
    with pytest.raises(MaterialError, match="has 1 families of fibres, not 2"):
        system_of(case_of(TUBE, **{"materials.tissue": two}))
    with pytest.raises(MaterialError, match="no length"):
        ConstantDirection(vector=(0.0, 0.0, 0.0))
    assert load_set("muscle_blemker").source
