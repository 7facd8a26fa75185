"""Calibration on a ring whose answer is known from another value of the parameter."""

from __future__ import annotations

import numpy as np
import pytest

from ngfsi.case import Case, Conditions, Materials
from ngfsi.errors import MaterialError
from ngfsi.identify.section import Model, area_loss, calibrate, curve, identify
from ngfsi.materials import load_set
from ngfsi.outlines.displacement import OutlineDisplacement
from ngfsi.outlines.outline import Outline
from ngfsi.solve.statics import section_case
from tests.solve.test_statics import INNER, OUTER, Ring
from tests.vein import domain_of

SKIN = Outline.circle(0, 0, OUTER).points
VEIN = area_loss("lumen", np.pi * INNER**2)


def case_of(K: float, **changes: float) -> Case:
    squeezed = OutlineDisplacement.between(SKIN, 0.985 * SKIN)
    tissue = load_set("mooney_rivlin_s1").replace(K=K)
    case = section_case(Ring(hole="lumen"), Materials(tissue=tissue), conditions=Conditions(skin_displacement=squeezed))
    return case.replace(**changes)


def model_of(*parameters: str, case: Case | None = None) -> Model:
    case = case or case_of(50e3)
    return Model(case, parameters, domain_of(case.geometry))


def test_a_bulk_modulus_is_found_from_the_area_of_the_lumen() -> None:
    target = VEIN(model_of("materials.tissue.K", case=case_of(28.45e3))(28.45e3))
    found = calibrate(model_of("materials.tissue.K"), VEIN, target, 50e3)
    assert found.value == pytest.approx(28.45e3, rel=1e-3)
    assert found.solves <= 6
    assert found.measure == pytest.approx(target, rel=1e-3)


def test_a_larger_modulus_means_a_larger_loss() -> None:
    values, losses = curve(model_of("materials.tissue.K"), VEIN, (5e3, 20e3, 80e3, 320e3))
    assert len(values) == 4
    assert np.all(np.diff(losses) > 0)
    # incompressible tissue would give all that the skin encloses less to the lumen
    assert losses[-1] < (1 - 0.985**2) * (OUTER / INNER) ** 2


def test_what_cannot_be_met_is_said() -> None:
    with pytest.raises(MaterialError, match=r"no value of materials.tissue.K gives 0.9: .* gives"):
        calibrate(model_of("materials.tissue.K"), VEIN, 0.9, 50e3)


def test_two_parameters_at_once() -> None:
    """A known pressure on the skin: areas of skin and hole around a bone tell K and c10 apart; displacement cannot."""
    tissue = load_set("mooney_rivlin_s1")
    from ngfsi.units import MMHG

    def model(K: float, c10: float) -> Model:
        law = tissue.replace(K=K, c10=c10)
        case = section_case(Ring(hole="tibia"), Materials(tissue=law), skin=10 * MMHG)
        return Model(case, ("materials.tissue.K", "materials.tissue.c10"), domain_of(case.geometry))

    skin = area_loss("skin", np.pi * OUTER**2)
    small = lambda probe: probe.pressure_over("tibia", "tissue") / 1e3  # noqa: E731
    truth = model(28.45e3, 13.1e3)(28.45e3, 13.1e3)
    targets = {"skin": (skin, skin(truth)), "pressure at the bone": (small, small(truth))}
    found = identify(model(34e3, 14e3), targets, (34e3, 14e3))
    assert found.values == pytest.approx([28.45e3, 13.1e3], rel=1e-3)
    assert found.misfit < 1e-5
    assert -1 < found.correlation[0, 1] < 1
    with pytest.raises(MaterialError, match="2 parameters need as many measures at least, there are 1"):
        identify(model(34e3, 14e3), {"skin": targets["skin"]}, (34e3, 14e3))
