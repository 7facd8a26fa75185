"""Cases: read, written, compared, changed, and refused in one sentence that names file and key."""

from __future__ import annotations

import copy
import tomllib
from pathlib import Path
from typing import Any

import pytest
from ngfsi_geometry.calf import CalfSegment

from ngfsi.case import Case, Loads, Materials, TimeStepping
from ngfsi.case.geometries import find_geometry, name_of
from ngfsi.config.functions import PressureConstant, PressureRamp, PressureTable
from ngfsi.errors import CaseError, GeometryError, MaterialError
from ngfsi.materials import Hencky, MooneyRivlin, load_set

TEXT = """
name = "demo"

[geometry]
type = "calf"
lumen_diameter_mm = 11.1

[materials]
tissue = { set = "mooney_rivlin_s1", K_kPa = 30 }
wall = { law = "hencky", young_kPa = 133, poisson = 0.49, density_kg_m3 = 1060 }
fluid = { set = "blood" }

[loads]
skin_pressure = { kind = "ramp", final_mmHg = 25, duration_s = 1.0 }

[time]
step_ms = 50
end_s = 1.5
"""


def changed(path: str, value: object) -> dict[str, Any]:
    """Return the case above with one key changed, added or, for None, removed."""
    data = tomllib.loads(TEXT)
    node = data
    *parents, last = path.split(".")
    for part in parents:
        node = node.setdefault(part, {})
    if value is None:
        del node[last]
    else:
        node[last] = value
    return data


@pytest.fixture
def case() -> Case:
    return Case.from_dict(tomllib.loads(TEXT))


def test_values_in_si_and_defaults(case: Case) -> None:
    assert case.name == "demo"
    assert case.geometry == CalfSegment(lumen_diameter=0.0111)
    assert case.materials.tissue == load_set("mooney_rivlin_s1", K_kPa=30)
    assert case.materials.wall == Hencky(young=133e3, poisson=0.49, density=1060)
    assert case.materials.fluid == load_set("blood")
    assert case.loads.skin_pressure == PressureRamp(final=3333.05, duration=1.0)
    assert case.loads.inlet_flow(0.3) == 2.913e-6
    assert case.loads.outlet_pressure == PressureConstant(value=1333.22)
    assert (case.conditions.ends, case.conditions.initial_state) == ("roller", "preload")
    assert (case.discretisation.order, case.discretisation.extension_stiffness) == (2, 1.0)
    assert case.time == TimeStepping(step=0.05, end=1.5, scheme="bdf2", smallest_step=0.05 / 64)
    assert (case.solver.tolerance, case.solver.max_iterations, case.solver.linear) == (1e-7, 25, "auto")


def test_the_same_case_in_python(case: Case) -> None:
    assert case == Case(
        name="demo",
        geometry=CalfSegment(lumen_diameter=0.0111),
        materials=Materials(
            tissue=load_set("mooney_rivlin_s1", K_kPa=30),
            wall=Hencky(young=133e3, poisson=0.49, density=1060),
            fluid=load_set("blood"),
        ),
        loads=Loads(skin_pressure=PressureRamp(final=3333.05, duration=1)),
        time=TimeStepping(step=0.05, end=1.5),
    )


def test_round_trip_is_exact(case: Case, tmp_path: Path) -> None:
    table = PressureTable(times=(0.0, 1 / 3), values=(0.1, 1e5 / 7))
    odd = case.replace(**{"time.step": 1 / 30, "loads.outlet_pressure": table, "materials.tissue.K": 1e5 / 3})
    for number, given in enumerate((case, odd)):
        file = tmp_path / f"{number}.toml"
        file.write_text(given.to_toml(), encoding="utf-8")
        read = Case.from_toml(file)
        assert read == given
        assert read.digest == given.digest
        assert read.to_toml() == given.to_toml()


def test_digest_depends_on_all_but_the_name(case: Case) -> None:
    assert case.replace(name="other").digest == case.digest
    digests = {case.digest, *(case.replace(**{key: value}).digest for key, value in OTHER.items())}
    assert len(digests) == len(OTHER) + 1
    assert len(case.digest) == 64


OTHER: dict[str, Any] = {
    "geometry.lumen_diameter": 0.008,
    "materials.tissue.K": 30001.0,
    "materials.wall": {"set": "vein_wall_source"},
    "loads.skin_pressure.final": 3333.06,
    "conditions.ends": "free",
    "discretisation.order": 3,
    "time.step": 0.01,
    "solver.tolerance": 1e-9,
    "output.fields_every": 1,
}


def test_replace(case: Case) -> None:
    new = case.replace(
        **{
            "materials.tissue": {"set": "neo_hookean_likely"},
            "geometry.lumen_diameter_mm": 8,
            "time.step": 0.01,
            "time.end": 0.02,
            "name": "n",
        }
    )
    assert new.materials.tissue == load_set("neo_hookean_likely")
    assert new.materials.wall == case.materials.wall
    assert new.geometry.lumen_diameter == 0.008
    assert (new.time.step, new.time.end, new.time.smallest_step) == (0.01, 0.02, 0.01 / 64)
    assert (new.name, case.name) == ("n", "demo")
    with pytest.raises(MaterialError, match=r"^materials\.tissue\.K_kPa = -1 is not accepted"):
        case.replace(**{"materials.tissue.K_kPa": -1})
    with pytest.raises(CaseError, match=r"^'time\.stp' is not a known key: did you mean 'step_s'"):
        case.replace(**{"time.stp": 1})


def test_an_override_may_use_any_unit() -> None:
    for override in ({"K_kPa": 30}, {"K_Pa": 3e4}, {"K_MPa": 0.03}):
        tissue = Case.from_dict(changed("materials.tissue", {"set": "mooney_rivlin_s2", **override})).materials.tissue
        assert isinstance(tissue, MooneyRivlin)
        assert (tissue.K, tissue.c10) == (30e3, 13.1e3)
    named = Case.from_dict(changed("materials.tissue", {"set": "mooney_rivlin_s2", "label": "M"})).materials.tissue
    assert named.label == "M"


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("tiem", 3, "'tiem' is not a known key: did you mean 'time'? accepted here are format, name, geometry"),
        ("name", None, "'name' is missing: a Case needs it"),
        ("name", "a/b", "name: 'a/b' cannot name a folder"),
        ("name", "..", "name: '..' cannot name a folder"),
        ("name", 3, "name = 3 is not accepted: text in quotes is wanted"),
        ("geometry", 3, "geometry = 3 is not accepted: a table with type = a name such as \"calf\""),
        ("geometry.type", None, "'geometry.type' is missing: write the name of a geometry such as \"calf\""),
        ("geometry.type", "clf", "'geometry.type' cannot be used: 'clf' is not a known geometry: did you mean 'calf'?"),
        ("geometry.type", "geometry.calf:CalfSegment", "'geometry.type' cannot be used: geometries are named, not "
         "imported by 'geometry.calf:CalfSegment': write type = \"calf\""),
        ("geometry.lumen_diameter_mm", -3, "geometry.lumen_diameter_mm = -3 is not accepted: a number greater than 0"),
        ("geometry.lumen_diametr_mm", 3, "'geometry.lumen_diametr_mm' is not a known key: did you mean 'lumen_d"),
        ("geometry.lumen_diameter", 3, "'geometry.lumen_diameter' needs its unit in the key: write 'lumen_diameter_m'"),
        ("geometry.lumen_diameter_mm", 300, "geometry: "),
        ("materials.bone", {}, "'materials.bone' is not a known key: accepted here are tissue, wall, sheath, soli"),
        ("materials.solid", {"law": "hencky", "young_Pa": 1, "poisson": 0.3, "density_kg_m3": 1},
         "'materials.solid' is of no region: those of CalfSegment are fluid, tissue, wall"),
        ("materials.wall", None, "'materials.wall' is missing: CalfSegment has such a region"),
        ("materials.tissue.K_kPa", -1, "materials.tissue.K_kPa = -1 is not accepted: a number greater than 0 is wan"),
        ("materials.tissue.c10_kPa", "1", "materials.tissue.c10_kPa = '1' is not accepted: a number is wanted"),
        ("materials.tissue.c10_kPa", -1, "materials.tissue: the initial shear modulus 2 (c10 + c01) must be greater"),
        ("materials.tissue.c10_kpa", 1, "'materials.tissue.c10_kpa' is not a known key: did you mean 'c10_kPa'?"),
        ("materials.tissue.c10", 1, "'materials.tissue.c10' needs its unit in the key: write 'c10_Pa' or 'c10_kPa'"),
        ("materials.tissue.set", "mooney_rivlin_s5", "'materials.tissue.set' has an unknown value: 'mooney_rivlin_s5'"),
        ("materials.tissue.set", ["x"], "'materials.tissue.set' has an unknown value"),
        ("materials.tissue.set", "blood", "'materials.tissue.set' has an unknown value: 'blood' is not a known "
                                          "parameter set for this region: known are adventitia, crural_fascia, fat"),
        ("materials.tissue.law", "hencky", "'materials.tissue.law' contradicts the set: 'mooney_rivlin_s1' is of law"),
        ("materials.tissue", "soft", "materials.tissue = 'soft' is not accepted: a table with set = one of adven"),
        ("materials.wall.law", "hency", "'materials.wall.law' has an unknown value: 'hency' is not a known law: did y"),
        ("materials.wall.law", "newtonian", "'materials.wall.law' has an unknown value: 'newtonian' is not a known"),
        ("materials.wall.poisson", 0.5, "materials.wall.poisson = 0.5 is not accepted: a number less than 0.5 is wan"),
        ("materials.wall.young_kPa", True, "materials.wall.young_kPa = true is not accepted: a number is wanted"),
        ("materials.wall.c10_kPa", 1, "'materials.wall.c10_kPa' is not a known key"),
        ("materials.fluid", {}, "materials.fluid = {} is not accepted: a table with set = one of blood, blood_an"),
        ("loads.skin_pressure.final_mmHG", 5, "'loads.skin_pressure.final_mmHG' is not a known key: did you mean 'f"),
        ("conditions.ends", "rolller", "conditions.ends = 'rolller' is not accepted: did you mean 'roller'? one of"),
        ("discretisation.order", 1, "discretisation.order = 1 is not accepted: a number of at least 2 is wanted"),
        ("discretisation.order", 7, "discretisation.order = 7 is not accepted: a number of at most 6 is wanted"),
        ("discretisation.order", 2.0, "discretisation.order = 2.0 is not accepted: a whole number is wanted"),
        ("discretisation.extension_stiffness", 0, "discretisation.extension_stiffness = 0 is not accepted"),
        ("time.step_ms", 0, "time.step_ms = 0 is not accepted: a number greater than 0 is wanted"),
        ("time.step_ms", "x", "time.step_ms = 'x' is not accepted: a number is wanted"),
        ("time.step_ms", 2000, "time: the step of 2 s is longer than the run, which ends at 1.5 s"),
        ("time.smallest_step_s", 1, "time: the smallest step of 1 s exceeds the step of 0.05 s"),
        ("time.scheme", "bdf", "time.scheme = 'bdf' is not accepted: did you mean 'bdf2'? one of 'bdf2', 'backward"),
        ("solver.tolerance", 1, "solver.tolerance = 1 is not accepted: a number less than 1 is wanted"),
        ("solver.max_iterations", 0, "solver.max_iterations = 0 is not accepted: a number of at least 1 is wanted"),
        ("solver.linear", "lu", "solver.linear = 'lu' is not accepted: one of 'auto', 'pardiso', 'pardiso_single'"),
        ("output.fields_every", -1, "output.fields_every = -1 is not accepted: a number of at least 0 is wanted"),
    ],
)  # fmt: skip
def test_refused_in_one_sentence(path: str, value: object, said: str) -> None:
    with pytest.raises(CaseError) as caught:
        Case.from_dict(changed(path, value), source="my.toml")
    text = str(caught.value)
    assert text.startswith("my.toml: " + said)
    assert "\n" not in text
    assert "pydantic" not in text


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match=r"none\.toml' cannot be read: No such file"):
        Case.from_toml(tmp_path / "none.toml")
    with pytest.raises(CaseError, match="cannot be read: Is a directory"):
        Case.from_toml(tmp_path)
    file = tmp_path / "x.toml"
    file.write_text("name = demo")
    with pytest.raises(CaseError, match=r"x\.toml' is not valid TOML: .* \(at line 1"):
        Case.from_toml(file)
    file.write_bytes(b"name = '\xff'")
    with pytest.raises(CaseError, match=r"x\.toml' is not text in UTF-8"):
        Case.from_toml(file)
    file.write_text("")
    with pytest.raises(CaseError, match=r"x\.toml: 'name' is missing"):
        Case.from_toml(file)


def test_geometries_are_found_by_name() -> None:
    assert find_geometry("calf") is CalfSegment
    assert name_of(CalfSegment) == "calf"

    class Nameless(CalfSegment):
        pass

    with pytest.raises(GeometryError, match=r"Nameless has no name in case files: write @register\("):
        name_of(Nameless)


@pytest.mark.parametrize(
    "old", ["geometry.labelled:LabelledCalf", "ngfsi_geometry.labelled:LabelledCalf", "elsewhere:LabelledCalf"]
)
def test_old_import_paths_are_told_the_name(old: str) -> None:
    with pytest.raises(GeometryError, match=r"not imported by '.*': write type = \"labelled_calf\"$"):
        find_geometry(old)


@pytest.mark.parametrize(
    "name", ["", "os:system", "geometry.calf", "ngfsi_geometry.calf:", "ngfsi_geometry.calf:csg", "CalfSegment",
             "ngfsi_geometry.none:A", "ngfsi_geometry.segment:MeshSettings", "mooney_rivlin"],
)  # fmt: skip
def test_names_of_no_geometry(name: str) -> None:
    with pytest.raises(GeometryError, match=r"is not a known geometry: .*known are .*bare_tube"):
        find_geometry(name)


def test_a_case_is_not_changed_by_reading(case: Case) -> None:
    data = tomllib.loads(TEXT)
    before = copy.deepcopy(data)
    assert Case.from_dict(data) == case
    assert data == before
    assert hash(case) == hash(Case.from_dict(data))


@pytest.mark.parametrize(
    ("step", "end", "steps"), [(0.01, 1.5, 150), (0.05, 1.0, 20), (0.1, 0.3, 3), (0.07, 1.4, 20), (0.2, 1.1, 6)]
)
def test_number_of_nominal_steps(step: float, end: float, steps: int) -> None:
    """Quotients that miss a whole number by rounding are that number; a rest is a step of its own."""
    assert TimeStepping(step=step, end=end).steps == steps
