"""Every solid law against what it must be: objective, at rest without stress, derived right, and equal to closed forms.

Energies are evaluated at numeric deformation gradients: F is built of nine parameters, and NGSolve differentiates.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from math import log

import numpy as np
import pytest
from ngsolve import CF, BilinearForm, CoefficientFunction, Grad, GridFunction, Id, Mesh, Parameter, VectorH1, dx
from ngsolve.meshes import MakeStructured3DMesh
from numpy.typing import NDArray
from scipy.linalg import logm

from ngfsi.errors import MaterialError
from ngfsi.materials import (
    CompressibleNeoHookean,
    Hencky,
    MooneyRivlin,
    NeoHookean,
    Newtonian,
    Ogden,
    SaintVenantKirchhoff,
    SolidLaw,
)
from ngfsi.materials.solid.fibres import FibreLaw
from ngfsi.registry import everything, find

Array = NDArray[np.float64]
I = np.eye(3)  # noqa: E741

MOONEY = MooneyRivlin(c10=13.1e3, c01=-9.61e3, c11=8.86e3, K=28.45e3, density=1060)
NEO = NeoHookean(C10=11.5e3, Kv=71.9e3, volumetric="K=Kv", density=1060)
NEO_LITERAL = NeoHookean(C10=11.5e3, Kv=71.9e3, volumetric="K=2Kv", density=1060)
SVK = SaintVenantKirchhoff(young=133e3, poisson=0.3, density=1060)
BONET = CompressibleNeoHookean(young=133e3, poisson=0.3, density=1060)
HENCKY = Hencky(young=133e3, poisson=0.3, density=1060)
OGDEN = Ogden(mu=(9e3, 4e3, -1e3), alpha=(-3.7, 2.0, 4.0), K=60e3, density=1060)

ALL = [MOONEY, NEO, NEO_LITERAL, SVK, BONET, HENCKY, OGDEN]
each_law = pytest.mark.parametrize("law", ALL, ids=lambda law: type(law).__name__ + getattr(law, "volumetric", ""))

# Lame's constants of E = 133 kPa, nu = 0.3, from the textbook formulas
MU = 133e3 / 2.6
LAM = 133e3 * 0.3 / (1.3 * 0.4)
# Poisson's ratios of 7 times that lambda, and of 7 times that bulk modulus
POISSON_7 = 7 * LAM / (2 * (7 * LAM + MU))
POISSON_7K = (3 * 7 * (LAM + 2 * MU / 3) - 2 * MU) / (2 * (3 * 7 * (LAM + 2 * MU / 3) + MU))
# expected initial shear and bulk modulus, written out by hand
MODULI = {
    MOONEY: (6980.0, 28450.0),
    NEO: (23000.0, 71900.0),
    NEO_LITERAL: (23000.0, 143800.0),
    SVK: (MU, LAM + 2 * MU / 3),
    BONET: (MU, LAM + 2 * MU / 3),
    HENCKY: (MU, LAM + 2 * MU / 3),
    OGDEN: (12e3, 60e3),
}


class Numeric:
    """A law as functions of numeric 3x3 matrices."""

    def __init__(self, law: SolidLaw) -> None:
        self._entries = [Parameter(0.0) for _ in range(9)]
        self._direction = [Parameter(0.0) for _ in range(9)]
        F = CF(tuple(self._entries), dims=(3, 3)).MakeVariable()
        H = CF(tuple(self._direction), dims=(3, 3))
        self._W = law.energy(F)
        directions = [CF(tuple(unit(i, j).ravel()), dims=(3, 3)) for i in range(3) for j in range(3)]
        self._P = CF(tuple(law.variation(F, direction) for direction in directions), dims=(3, 3))
        by_part = zip(*(law.variations(F, direction) for direction in directions), strict=True)
        self._parts = [CF(tuple(part), dims=(3, 3)) for part in by_part]
        self._dP = self._P.Diff(F, H)
        self._point = unit_mesh()(0.3, 0.3, 0.3)

    def _at(self, cf: CoefficientFunction, F: Array) -> Array:
        for entry, value in zip(self._entries, F.ravel(), strict=True):
            entry.Set(value)
        return np.array(cf(self._point))

    def energy(self, F: Array) -> float:
        return float(self._at(self._W, F))

    def stress(self, F: Array) -> Array:
        """First Piola-Kirchhoff stress."""
        return self._at(self._P, F).reshape(3, 3)

    def stresses(self, F: Array) -> tuple[Array, Array]:
        """First Piola-Kirchhoff stress without and by what grows with the bulk modulus."""
        rest, bulk = (self._at(part, F).reshape(3, 3) for part in self._parts)
        return rest, bulk

    def stress_rate(self, F: Array, H: Array) -> Array:
        """Derivative of the first Piola-Kirchhoff stress in direction H."""
        for entry, value in zip(self._direction, H.ravel(), strict=True):
            entry.Set(value)
        return self._at(self._dP, F).reshape(3, 3)

    def cauchy(self, F: Array) -> Array:
        return self.stress(F) @ F.T / np.linalg.det(F)


@cache
def unit_mesh() -> Mesh:
    """Six tetrahedra, curved by nothing."""
    return MakeStructured3DMesh(hexes=False, nx=1, ny=1, nz=1)


@cache
def numeric(law: SolidLaw) -> Numeric:
    return Numeric(law)


def rotation(rng: np.random.Generator) -> Array:
    Q, R = np.linalg.qr(rng.standard_normal((3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q * np.sign(np.linalg.det(Q))


def deformations(count: int = 4, low: float = 0.6, high: float = 1.7) -> list[Array]:
    """Random deformation gradients with principal stretches in a range, rotated on both sides."""
    rng = np.random.default_rng(7)
    return [rotation(rng) @ np.diag(rng.uniform(low, high, 3)) @ rotation(rng) for _ in range(count)]


def difference(f: Callable[[Array], Array | float], x: Array, direction: Array, h: float = 5e-4) -> Array:
    """Derivative of f at x in a direction by the central difference of fourth order."""
    near = np.subtract(f(x + h * direction), f(x - h * direction))
    far = np.subtract(f(x + 2 * h * direction), f(x - 2 * h * direction))
    return (8 * near - far) / (12 * h)


def unit(i: int, j: int) -> Array:
    H = np.zeros((3, 3))
    H[i, j] = 1.0
    return H


def uniaxial(stretch: float) -> Array:
    """Incompressible."""
    return np.diag([stretch, stretch**-0.5, stretch**-0.5])


def test_the_battery_covers_every_law() -> None:
    assert {type(law) for law in ALL} == {
        law
        for law in everything("ngfsi.solid_laws", "law").values()
        if law.__module__.startswith("ngfsi.") and not issubclass(law, FibreLaw)
    }


@pytest.mark.parametrize(
    ("law", "stiffer"),
    [
        (MOONEY, MOONEY.replace(K=7 * MOONEY.K)),
        (NEO, NEO.replace(Kv=7 * NEO.Kv)),
        (OGDEN, OGDEN.replace(K=7 * OGDEN.K)),
        *((law, law.replace(poisson=POISSON_7, young=2 * MU * (1 + POISSON_7))) for law in (SVK, BONET)),
        (HENCKY, HENCKY.replace(poisson=POISSON_7K, young=2 * MU * (1 + POISSON_7K))),
    ],
    ids=lambda law: type(law).__name__,
)
def test_one_part_alone_grows_with_the_bulk_modulus(law: SolidLaw, stiffer: SolidLaw) -> None:
    """7 times the bulk modulus, or lambda, at the same shear modulus, and the parts make the whole."""
    for F in deformations():
        rest, bulk = numeric(law).stresses(F)
        still, grown = numeric(stiffer).stresses(F)
        assert np.linalg.norm(still - rest) < 1e-10 * np.linalg.norm(rest)
        assert np.linalg.norm(grown - 7 * bulk) < 1e-10 * np.linalg.norm(grown)
        assert np.linalg.norm(rest + bulk - numeric(law).stress(F)) < 1e-11 * np.linalg.norm(rest)


@each_law
def test_rest_has_neither_energy_nor_stress(law: SolidLaw) -> None:
    rng = np.random.default_rng(1)
    for F in (I, rotation(rng)):
        assert numeric(law).energy(F) == pytest.approx(0, abs=1e-11 * law.bulk_modulus)
        assert np.abs(numeric(law).stress(F)).max() < 1e-11 * law.bulk_modulus


@each_law
def test_energy_is_positive_away_from_rest(law: SolidLaw) -> None:
    for F in deformations(8, 0.85, 1.15):
        assert numeric(law).energy(F) > 0


@each_law
def test_objective_and_isotropic(law: SolidLaw) -> None:
    rng = np.random.default_rng(2)
    for F in deformations():
        Q = rotation(rng)
        W = numeric(law).energy(F)
        assert numeric(law).energy(Q @ F) == pytest.approx(W, rel=1e-11)
        assert numeric(law).energy(F @ Q) == pytest.approx(W, rel=1e-11)


@each_law
def test_stress_is_the_derivative_of_the_energy(law: SolidLaw) -> None:
    for F in deformations():
        directions = [unit(i, j) for i in range(3) for j in range(3)]
        by_difference = np.array([difference(numeric(law).energy, F, H) for H in directions])
        P = numeric(law).stress(F)
        assert np.abs(by_difference.reshape(3, 3) - P).max() < 1e-8 * np.abs(P).max()


@each_law
def test_tangent_is_the_derivative_of_the_stress(law: SolidLaw) -> None:
    rng = np.random.default_rng(3)
    for F in deformations():
        H = rng.standard_normal((3, 3))
        by_difference = difference(numeric(law).stress, F, H)
        dP = numeric(law).stress_rate(F, H)
        assert np.abs(by_difference - dP).max() < 1e-8 * np.abs(dP).max()


@each_law
def test_initial_moduli(law: SolidLaw) -> None:
    # at rest W = G |dev e|^2 + K/2 (tr e)^2: simple shear has W'' = G, F = (1 + x) I has W'' = 9 K
    G, K = MODULI[law]
    shear = unit(0, 1)
    assert np.sum(shear * numeric(law).stress_rate(I, shear)) == pytest.approx(G, rel=1e-10)
    assert np.sum(I * numeric(law).stress_rate(I, I)) == pytest.approx(9 * K, rel=1e-10)
    assert (law.shear_modulus, law.bulk_modulus) == pytest.approx((G, K), rel=1e-14)
    # uniaxial stress at rest: E = sigma_11 / e_11 with sigma_22 = sigma_33 = 0
    assert law.youngs_modulus == pytest.approx(9 * K * G / (3 * K + G), rel=1e-14)
    e = np.diag([1.0, -law.poissons_ratio, -law.poissons_ratio])
    expected = np.diag([law.youngs_modulus, 0, 0])
    assert np.abs(numeric(law).stress_rate(I, e) - expected).max() < 1e-9 * law.youngs_modulus


@pytest.mark.parametrize("law", [SVK, BONET, HENCKY], ids=lambda law: law.law)
def test_linear_constants_are_recovered(law: SolidLaw) -> None:
    assert (law.youngs_modulus, law.poissons_ratio) == pytest.approx((133e3, 0.3), rel=1e-13)


def pressures(law: SolidLaw, J: float) -> float:
    """Return the Cauchy stress under F = J^(1/3) I from the derivative of each volumetric energy, done by hand."""
    a2 = J ** (2 / 3)
    K = LAM + 2 * MU / 3
    return {
        MOONEY: 28450 * (J - 1),
        NEO: 71900 / 2 * (J - 1 / J),
        NEO_LITERAL: 71900 * (J - 1 / J),
        SVK: 3 * K * (a2 - 1) / (2 * a2**0.5),
        BONET: (MU * (a2 - 1) + LAM * log(J)) / J,
        HENCKY: K * log(J) / J,
        OGDEN: 60e3 / 2 * (J - 1 / J),
    }[law]


@each_law
@pytest.mark.parametrize("J", [0.5, 0.9, 1.3, 2.0])
def test_dilation(law: SolidLaw, J: float) -> None:
    sigma = numeric(law).cauchy(J ** (1 / 3) * I)
    assert np.abs(sigma - pressures(law, J) * I).max() < 1e-11 * law.bulk_modulus


@pytest.mark.parametrize("stretch", [0.6, 0.9, 1.1, 1.8])
def test_mooney_rivlin_incompressible_closed_forms(stretch: float) -> None:
    # Rivlin: sigma = -p I + 2 W1 B - 2 W2 B^-1 with W1 = dW/dI1, W2 = dW/dI2 (e.g. Ogden, Non-linear Elastic
    # Deformations, 4.3); pressure drops out of differences
    def derivatives(I1: float, I2: float) -> tuple[float, float]:
        return 13.1e3 + 8.86e3 * (I2 - 3), -9.61e3 + 8.86e3 * (I1 - 3)

    x = stretch
    sigma = numeric(MOONEY).cauchy(uniaxial(x))
    W1, W2 = derivatives(x**2 + 2 / x, 2 * x + x**-2)
    assert sigma[0, 0] - sigma[1, 1] == pytest.approx(2 * (x**2 - 1 / x) * (W1 + W2 / x), rel=1e-11)

    sigma = numeric(MOONEY).cauchy(np.diag([x, x, x**-2]))
    W1, W2 = derivatives(2 * x**2 + x**-4, x**4 + 2 * x**-2)
    assert sigma[0, 0] - sigma[2, 2] == pytest.approx(2 * (x**2 - x**-4) * (W1 + W2 * x**2), rel=1e-11)

    shear = x - 1
    sigma = numeric(MOONEY).cauchy(I + shear * unit(0, 1))
    W1, W2 = derivatives(3 + shear**2, 3 + shear**2)
    assert sigma[0, 1] == pytest.approx(2 * shear * (W1 + W2), rel=1e-11)
    assert sigma[0, 0] - sigma[1, 1] == pytest.approx(2 * shear**2 * (W1 + W2), rel=1e-10)


@pytest.mark.parametrize("stretches", [(1, 1, 1), (2, 0.5, 0.5), (2, 2, 0.5), (2, 1, 0.5), (0.7, 1.3, 1.1)])
def test_ogden_by_principal_stretches(stretches: tuple[float, ...]) -> None:
    """tau_i = sum 2 mu/alpha (l_i^alpha - mean) + K/2 (J^2 - 1), also where stretches coincide; and its tangent."""

    def stress(F: Array) -> Array:
        vectors, principal, _ = np.linalg.svd(F)
        J = float(np.prod(principal))
        bar = principal * J ** (-1 / 3)
        powers = [(2 * mu / a, bar**a) for mu, a in zip(OGDEN.mu, OGDEN.alpha, strict=True)]
        tau = sum(c * (p - p.mean()) for c, p in powers) + OGDEN.K / 2 * (J**2 - 1)
        return np.asarray(vectors @ np.diag(tau) @ vectors.T @ np.linalg.inv(F).T)

    rng = np.random.default_rng(6)
    F = rotation(rng) @ np.diag(stretches) @ rotation(rng)
    P, H = numeric(OGDEN).stress(F), rng.standard_normal((3, 3))
    assert np.abs(P - stress(F)).max() < 1e-10 * OGDEN.K
    assert np.abs(numeric(OGDEN).stress_rate(F, H) - difference(stress, F, H)).max() < 1e-7 * OGDEN.K


@pytest.mark.parametrize("law", [MOONEY, NEO, OGDEN], ids=lambda law: law.law)
def test_dilation_and_distortion_are_uncoupled(law: SolidLaw) -> None:
    # W(J^(1/3) F) = W(J^(1/3) I) + W(F) for every F of determinant 1; fails for plain invariants
    for F in deformations():
        F = F / np.linalg.det(F) ** (1 / 3)
        W, a = numeric(law), 1.7 ** (1 / 3)
        assert W.energy(a * F) == pytest.approx(W.energy(a * I) + W.energy(F), rel=1e-11)


@pytest.mark.parametrize("stretch", [0.6, 1.8])
def test_neo_hookean_uniaxial(stretch: float) -> None:
    sigma = numeric(NEO).cauchy(uniaxial(stretch))
    assert sigma[0, 0] - sigma[1, 1] == pytest.approx(2 * 11.5e3 * (stretch**2 - 1 / stretch), rel=1e-11)


@pytest.mark.parametrize("stretch", [0.5, 0.8, 1.3, 2.0])
def test_confined_uniaxial_stretch(stretch: float) -> None:
    F = np.diag([stretch, 1.0, 1.0])
    P = numeric(SVK).stress(F)
    assert P[0, 0] == pytest.approx((LAM / 2 + MU) * (stretch**3 - stretch), rel=1e-12)
    assert P[1, 1] == pytest.approx(LAM / 2 * (stretch**2 - 1), rel=1e-12)

    sigma = numeric(BONET).cauchy(F)
    assert sigma[0, 0] == pytest.approx((MU * (stretch**2 - 1) + LAM * log(stretch)) / stretch, rel=1e-12)
    assert sigma[1, 1] == pytest.approx(LAM * log(stretch) / stretch, rel=1e-12)

    tau = numeric(HENCKY).cauchy(F) * stretch
    assert tau[0, 0] == pytest.approx((LAM + 2 * MU) * log(stretch), rel=1e-11)
    assert tau[1, 1] == pytest.approx(LAM * log(stretch), rel=1e-11)


def hencky_stress(F: Array) -> Array:
    """First Piola-Kirchhoff stress of Hencky's law: tau = 2 mu dev ln V + K ln J I, by the eigenvalues of F F^T."""
    values, vectors = np.linalg.eigh(F @ F.T)
    strain = vectors @ np.diag(np.log(values) / 2) @ vectors.T
    tau = 2 * MU * strain + LAM * np.trace(strain) * I
    return tau @ np.linalg.inv(F).T


@pytest.mark.parametrize("stretches", [(2, 0.5, 0.5), (2, 2, 0.5), (0.5, 0.5, 0.5), (2, 1, 0.5), (1.2, 1.2, 1.2)])
def test_hencky_at_the_ends_of_its_range(stretches: tuple[float, ...]) -> None:
    rng = np.random.default_rng(4)
    F = rotation(rng) @ np.diag(stretches) @ rotation(rng)
    P = numeric(HENCKY).stress(F)
    assert np.abs(P - hencky_stress(F)).max() < 1e-11 * np.abs(P).max()
    H = rng.standard_normal((3, 3))
    dP = numeric(HENCKY).stress_rate(F, H)
    by_difference = difference(hencky_stress, F, H)
    assert np.abs(dP - by_difference).max() < 1e-8 * np.abs(dP).max()


def test_hencky_energy_and_its_symmetry_under_inversion() -> None:
    for F in deformations(4, 0.5, 2.0):
        strain = logm(F.T @ F) / 2
        W = MU * np.sum(strain * strain) + LAM / 2 * np.trace(strain) ** 2
        assert numeric(HENCKY).energy(F) == pytest.approx(W, rel=1e-11)
        assert numeric(HENCKY).energy(np.linalg.inv(F)) == pytest.approx(W, rel=1e-11)


@each_law
def test_forms_can_be_linearised(law: SolidLaw) -> None:
    """Jacobian of the weak form against differences of its residual, on a deformed mesh of six tetrahedra."""
    V = VectorH1(unit_mesh(), order=2)
    u, v = V.TnT()
    F = (Id(3) + Grad(u)).MakeVariable()
    form = BilinearForm(V)
    form += law.energy(F).Diff(F, Grad(v)) * dx

    rng = np.random.default_rng(5)
    state, direction = 0.05 * rng.standard_normal(V.ndof), rng.standard_normal(V.ndof)
    given, result = GridFunction(V).vec, GridFunction(V).vec

    def residual(x: Array) -> Array:
        given.FV().NumPy()[:] = x
        form.Apply(given, result)
        return np.array(result.FV().NumPy())

    by_difference = difference(residual, state, direction, 2e-4)
    given.FV().NumPy()[:] = state
    form.AssembleLinearization(given)
    given.FV().NumPy()[:] = direction
    product = (form.mat * given).Evaluate().FV().NumPy()
    assert np.abs(residual(state)).max() > 0.01 * law.shear_modulus  # the state is really deformed
    assert np.abs(product - by_difference).max() < 1e-7 * np.abs(product).max()


@pytest.mark.parametrize(
    ("law", "values", "said"),
    [
        (MooneyRivlin, {"c10": 1.0, "c01": -1.0, "c11": 0.0, "K": 1.0}, "initial shear modulus"),
        (MooneyRivlin, {"c10": 1.0, "c01": 0.0, "c11": 0.0, "K": 0.0}, "K = 0.0"),
        (NeoHookean, {"C10": -1.0, "Kv": 1.0, "volumetric": "K=Kv"}, "C10 = -1.0"),
        (NeoHookean, {"C10": 1.0, "Kv": 1.0, "volumetric": "K=3Kv"}, "K=2Kv"),
        (NeoHookean, {"C10": 1.0, "Kv": 1.0}, "volumetric"),
        (SaintVenantKirchhoff, {"young": 0.0, "poisson": 0.3}, "young = 0.0"),
        (Hencky, {"young": 1.0, "poisson": 0.5}, "poisson = 0.5"),
        (Ogden, {"mu": (1.0,), "alpha": (2.0, 3.0), "K": 1.0}, "each term needs both"),
        (Ogden, {"mu": (1.0,), "alpha": (0.0,), "K": 1.0}, "alpha must not be 0"),
        (Ogden, {"mu": (1.0, -2.0), "alpha": (2.0, 3.0), "K": 1.0}, "initial shear modulus"),
        (CompressibleNeoHookean, {"young": 1.0, "poisson": -1.0}, "poisson = -1.0"),
        (CompressibleNeoHookean, {"young": 1.0, "poisson": 0.3, "density": -1.0}, "density = -1.0"),
        (Hencky, {"young": float("nan"), "poisson": 0.3}, "finite"),
        (Newtonian, {"viscosity": 0.0}, "viscosity = 0.0"),
        (Newtonian, {"viscosity": 1.0, "density": 0.0}, "density = 0.0"),
    ],
)
def test_parameters_that_are_not_physical_are_refused(law: type, values: dict[str, object], said: str) -> None:
    with pytest.raises(MaterialError, match=re.escape(said)) as caught:
        law(**{"density": 1060.0, **values})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("law", [*ALL, Newtonian(density=1060, viscosity=3.5e-3)], ids=lambda law: law.law)
def test_laws_survive_being_written(law: SolidLaw) -> None:
    assert type(law).from_dict(law.to_toml_dict()) == law
    assert find("ngfsi.solid_laws" if isinstance(law, SolidLaw) else "ngfsi.fluid_laws", law.law, "law") is type(law)
    assert law.label == law.law
    assert law.formula
    assert law.source
