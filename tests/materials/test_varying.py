"""Moduli that vary in space: a bar by quadrature, fields from files, and every modulus of every law."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from ngfsi_geometry.segment import MeshSettings
from ngfsi_geometry.tube import BareTube
from scipy.integrate import quad

from ngfsi import registry
from ngfsi.case import Case, Conditions, Discretisation, Loads, Materials, TimeStepping
from ngfsi.conditions import BodyForceModel, DisplacementModel
from ngfsi.config.functions import FactorConstant, PressureConstant
from ngfsi.config.model import dimension_of_field
from ngfsi.errors import MaterialError
from ngfsi.materials import CompressibleNeoHookean, SolidLaw
from ngfsi.materials.solid.directions import ConstantDirection
from ngfsi.materials.solid.varying import ByHeight, FromFile
from ngfsi.solve.statics import equilibrium
from tests.vein import TISSUE, TUBE, case_of, domain_of, set_motion, system_of

LENGTH, HEIGHTS, FACTORS = 20e-3, (0.0, 10e-3, 15e-3), (1.0, 1.6, 0.9)
BAR = BareTube(
    hollow=True, length=LENGTH, lumen_diameter=10e-3, wall_thickness=4e-3,
    mesh=MeshSettings(element="mixed", axial_layers=4, vein_size=6e-3, curving_order=3),
)  # fmt: skip
SOFT = CompressibleNeoHookean(young=100e3, poisson=0.0, density=1060.0)


@pytest.mark.parametrize("strain", ["small", "finite"])
def test_a_bar_under_its_weight(strain: Any) -> None:
    """u(z) = int rho g (L - z)/E(z) dz, held at the bottom; at so small a weight both strains are one."""
    law = SOFT.replace(varying=(ByHeight(parameter="young", z=HEIGHTS, factors=FACTORS),))
    held = DisplacementModel(
        boundaries=("wall_bottom",), displacement=(0.0, 0.0, 0.0), over_time=FactorConstant(value=1.0)
    )
    case = Case(
        name="bar", geometry=BAR, materials=Materials(wall=law), time=TimeStepping(step=1.0, end=1.0),
        loads=Loads(outlet_pressure=PressureConstant(value=0.0),
                    further=(held, BodyForceModel(acceleration=(0.0, 0.0, 0.01)))),
        conditions=Conditions(ends="free", strain=strain), discretisation=Discretisation(order=4),
    )  # fmt: skip
    system = equilibrium(case, domain_of(BAR))

    def slope(z: float) -> float:
        return SOFT.density * 0.01 * (LENGTH - z) / (SOFT.young * float(np.interp(z, HEIGHTS, FACTORS)))

    for end in (5e-3, 10e-3, LENGTH - 1e-9):
        wanted = quad(slope, 0, end, points=HEIGHTS[1:], epsrel=1e-10)[0]
        found = system.domain.value(system.motion, 7e-3, 0.0, end)[2]
        assert found == pytest.approx(wanted, rel=1e-5)


def stress(law: SolidLaw, place: tuple[float, float, float] = (10e-3, 1e-3, 3e-3)) -> Any:
    """Return the stress (Pa, 3x3) of a tissue under a motion of all invariants, at a place."""
    system = system_of(case_of(TUBE, **{"materials.tissue": law}))
    F = np.array([[1.1, 0.2, -0.05], [-0.1, 0.95, 0.15], [0.05, 0.1, 1.2]])
    motion = ng.CF(tuple((F - np.eye(3)).ravel().tolist()), dims=(3, 3)) * ng.CF((ng.x, ng.y, ng.z))
    set_motion(system, motion)
    return np.array(system.domain.value(system.cauchy_stress("tissue"), *place))


WAY = (ConstantDirection(vector=(1.0, 2.0, 2.0)),)
LINEAR = {"young": 30e3, "poisson": 0.3, "density": 0.0}
EXAMPLES: dict[str, dict[str, Any]] = {
    "compressible_neo_hookean": LINEAR, "hencky": LINEAR, "saint_venant_kirchhoff": LINEAR,
    "mooney_rivlin": {"c10": 13e3, "c01": -9e3, "c11": 8e3, "K": 28e3, "density": 0.0},
    "neo_hookean": {"C10": 5e3, "Kv": 30e3, "volumetric": "K=Kv", "density": 0.0},
    "ogden": {"mu": (3e3, 1e3), "alpha": (2.5, -3.0), "K": 30e3, "density": 0.0},
    "blemker": {"G1": 3e3, "G2": 5e3, "P1": 0.05, "P2": 6.6, "peak_stress": 3e5, "straight_stretch": 1.4, "K": 3e4,
                "density": 0.0, "fibres": WAY},
    "humphrey_yin": {"c1": 3e3, "c2": 4e3, "c3": 2e3, "c4": -1e3, "c5": 1e3, "K": 3e4, "density": 0.0, "fibres": WAY},
    "holzapfel_gasser_ogden": {"c": 3e3, "k1": 4e3, "k2": 2.0, "kappa": 0.1, "K": 3e4, "density": 0.0, "fibres": WAY},
}  # fmt: skip


def test_every_law_is_here() -> None:
    laws = registry.everything("ngfsi.solid_laws", "law")
    assert {*EXAMPLES} == {name for name, law in laws.items() if law.__module__.startswith("ngfsi.")}


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_modulus_of_every_law(name: str) -> None:
    """Each of its own factor at a height, against the law of those constants."""
    cls: Any = registry.find("ngfsi.solid_laws", name, "law")
    law = cls(**EXAMPLES[name])
    moduli = [key for key in cls.model_fields if dimension_of_field(cls, key) == "pressure"]
    factors = {key: 1.1 + 0.07 * n for n, key in enumerate(moduli)}
    varying = tuple(
        ByHeight(parameter=key, z=(0.0, 6e-3), factors=(0.0, 2 * factor)) for key, factor in factors.items()
    )
    given = {key: getattr(law, key) for key in moduli}
    changed = {key: tuple(factors[key] * one for one in value) if isinstance(value, tuple) else factors[key] * value
               for key, value in given.items()}  # fmt: skip
    wanted = stress(law.replace(**changed))
    assert stress(law.replace(varying=varying)) == pytest.approx(wanted, rel=1e-9, abs=1e-9 * np.abs(wanted).max())
    assert np.abs(stress(law) - wanted).max() > 0.05 * np.abs(wanted).max()


def grid(tmp_path: Path) -> str:
    """Write 1 + 100 z on points, and 2 on the upper half of cells."""
    import pyvista

    block = pyvista.ImageData(dimensions=(4, 4, 5), spacing=(10e-3, 10e-3, 2.5e-3), origin=(-15e-3, -15e-3, 0.0))
    found = block.cast_to_unstructured_grid()
    found.point_data["rising"] = 1 + 100 * found.points[:, 2]
    found.cell_data["step"] = np.where(found.cell_centers().points[:, 2] > 5e-3, 2.0, 1.0)
    found.cell_data["vectors"] = np.zeros((found.n_cells, 3))
    found.save(tmp_path / "field.vtu")
    return str(tmp_path / "field.vtu")


def test_a_field_from_a_file(tmp_path: Path) -> None:
    """Linear on points it is the table of the same values; on cells that of the nearest one; in a case it is kept."""
    file = grid(tmp_path)
    table = ByHeight(parameter="young", z=(0.0, 10e-3), factors=(1.0, 2.0))
    points, cells = (FromFile(parameter="young", file=file, array=name) for name in ("rising", "step"))
    for z in (1e-3, 5e-3, 9e-3):
        place = (9e-3, 3e-3, z)
        by_height, by_points = (stress(TISSUE.replace(varying=(one,)), place) for one in (table, points))
        assert by_points == pytest.approx(by_height, rel=1e-9)
    two_layers = TUBE.replace(mesh=TUBE.mesh.replace(axial_layers=2))
    domain = domain_of(two_layers)
    for z, factor in ((1e-3, 1.0), (9e-3, 2.0)):
        assert domain.value(cells.factor(domain, "tissue"), 9e-3, 3e-3, z) == factor
    case = case_of(TUBE, **{"materials.tissue": TISSUE.replace(varying=(points,))})
    assert Case.from_dict(case.to_toml_dict()) == case
    with pytest.raises(MaterialError, match="is of cells: a membrane needs one of points"):
        cells.factor(domain, "skin")
    for array, said in (("rise", "did you mean 'rising'"), ("vectors", "holds other than factors")):
        with pytest.raises(MaterialError, match=said):
            FromFile(parameter="young", file=file, array=array).factor(domain, "tissue")
    with pytest.raises(MaterialError, match="cannot be read"):
        FromFile(parameter="young", file=file + "x", array="rising").factor(domain, "tissue")


def test_what_is_refused() -> None:
    table = ByHeight(parameter="poisson", z=(0.0, 1.0), factors=(1.0, 2.0))
    with pytest.raises(MaterialError, match=r"'poisson' is not a known modulus.*known are young"):
        TISSUE.replace(varying=(table,))
    one = table.replace(parameter="young")
    with pytest.raises(MaterialError, match="two factors on 'young'"):
        TISSUE.replace(varying=(one, one))
    with pytest.raises(MaterialError, match="each height needs a factor"):
        table.replace(factors=(1.0,))
    with pytest.raises(MaterialError, match="the heights z must increase"):
        table.replace(z=(1.0, 0.0))
