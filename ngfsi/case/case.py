"""Case: everything a run depends on, as numbers and strings; read from and written to TOML.

Units stand in the keys (see config/model.py); `Case.from_toml` explains in one sentence what is wrong with a file.
"""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from math import ceil
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias

import tomli_w
from pydantic import (
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticCustomError, core_schema

from ngfsi import registry
from ngfsi.case.formats import FORMAT, PATTERN, is_older, reason_not_read
from ngfsi.case.formats import KEY as FORMAT_KEY
from ngfsi.case.geometries import GROUP, find_geometry, is_geometry, name_of
from ngfsi.conditions import ConditionModel, ContactModel, Cuff, FlowOpening, OpeningModel, PressureOpening
from ngfsi.config.functions import FlowConstant, FlowCurve, PressureConstant, PressureCurve
from ngfsi.config.messages import key_error
from ngfsi.config.model import ConfigModel, one_of, registered
from ngfsi.errors import CaseError, GeometryError, NgfsiError
from ngfsi.materials import FluidMaterial, SolidLaw, SolidMaterial
from ngfsi.materials.membrane import Membrane
from ngfsi.mesh.geometry import COMPARTMENTS
from ngfsi.outlines.displacement import OutlineDisplacement
from ngfsi.transport.models import ScalarModel, check_names
from ngfsi.units import MMHG, Pressure, Time


def _build_geometry(value: Any, info: ValidationInfo) -> Any:
    """Return the geometry that a table with its name under `type` describes."""
    if is_geometry(type(value)):
        return value
    if not isinstance(value, dict):
        raise PydanticCustomError("table", "{text}", {"text": 'a table with type = a name such as "calf"'})
    if not isinstance(value.get("type"), str):
        raise key_error("type", 'is missing: write the name of a geometry such as "calf"')
    try:
        geometry = find_geometry(value["type"])
    except GeometryError as error:
        raise key_error("type", f"cannot be used: {error}") from None
    return geometry.model_validate({key: v for key, v in value.items() if key != "type"}, context=info.context)


class _AnyGeometry:
    """The annotation that reads a table as the geometry of its `type`."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.with_info_before_validator_function(_build_geometry, handler(source))

    def __get_pydantic_json_schema__(self, _: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return one_of("type", {name: find_geometry(name) for name in registry.names(GROUP)}, handler)


def kind_of(region: str) -> str:
    """Return the name of a region without the number of its vessel: wall of wall_2."""
    return re.sub(r"_\d+$", "", region)


PARTS_OF_TISSUE = ("fat", *COMPARTMENTS)
"""Regions that are of the material of the tissue unless they have their own."""


class Materials(ConfigModel):
    """The material of each region that the geometry has."""

    tissue: SolidMaterial | None = None
    """Around the vessels: muscle, or what else stands for it."""
    wall: SolidMaterial | None = None
    """Walls of all vessels."""
    sheath: SolidMaterial | None = None
    """Loose connective tissue around the walls."""
    solid: SolidMaterial | None = None
    """The one solid of a plane benchmark."""
    fat: SolidMaterial | None = None
    """Under the skin; None: that of the tissue, as for the four compartments."""
    anterior: SolidMaterial | None = None
    """Muscles of the anterior compartment."""
    lateral: SolidMaterial | None = None
    """Muscles of the lateral compartment."""
    superficial_posterior: SolidMaterial | None = None
    """Muscles of the superficial posterior compartment."""
    deep_posterior: SolidMaterial | None = None
    """Muscles of the deep posterior compartment."""
    fluid: FluidMaterial | None = None
    """Blood in all vessels."""
    membranes: tuple[Membrane, ...] = ()
    """Thin stiff layers on boundaries: skin, fascia, interosseous membrane."""

    def law_of(self, region: str) -> SolidLaw:
        """Return the material of a solid region.

        Raises:
            CaseError: the case has no such solid.
        """
        law = getattr(self, kind_of(region), None)
        if law is None and region in PARTS_OF_TISSUE:
            law = self.tissue
        if not isinstance(law, SolidLaw):
            raise CaseError(f"'{region}' is no solid with a material in this case")
        return law


class Loads(ConfigModel):
    """What acts from outside, over time."""

    skin_pressure: PressureCurve = PressureConstant(value=0.0)
    """Everywhere on the skin."""
    cuffs: tuple[Cuff, ...] = ()
    """Pressures on parts of the skin, added to `skin_pressure`; together any function of z, angle and time."""
    inlet_flow: FlowCurve = FlowConstant(value=2.913e-6)
    """Flux of blood relative to the moving inlet; default: 1.12 times the flow of the study's subject 7."""
    inlet_pressure: PressureCurve | None = None
    """Pressure at the inlet, from which the flow follows; then `inlet_flow` is without effect."""
    outlet_pressure: PressureCurve = PressureConstant(value=10 * MMHG)
    """Blood pressure at the outlet; in veins that are holes in solids, which have no flow, all of it."""
    openings: dict[str, Annotated[OpeningModel, registered("kind", "ngfsi.openings", OpeningModel)]] = Field(
        default_factory=dict
    )
    """Name of an opening -> its condition, in place of the short forms above, which are those of `inlet` and `outlet`.
    """
    further: tuple[Annotated[ConditionModel, registered("kind", "ngfsi.conditions", ConditionModel)], ...] = ()
    """Whatever else acts: conditions by the `kind` under which they are registered."""

    def __hash__(self) -> int:
        return hash(tuple(tuple(value.items()) if isinstance(value, dict) else value for _, value in self))

    def opening(self, name: str) -> OpeningModel | None:
        """Return the condition at an opening; None: it has none."""
        if name in self.openings:
            return self.openings[name]
        if name == "inlet":
            if self.inlet_pressure is not None:
                return PressureOpening(pressure=self.inlet_pressure)
            return FlowOpening(flow=self.inlet_flow)
        return PressureOpening(pressure=self.outlet_pressure) if name == "outlet" else None

    @property
    def breakpoints(self) -> frozenset[float]:
        """Times (s) where the slope of a load jumps."""
        cuffs = (cuff.pressure for cuff in self.cuffs)
        ends = (self.opening(name) for name in {"inlet", "outlet", *self.openings})
        return frozenset(t for part in (self.skin_pressure, *cuffs, *ends, *self.further) for t in _kinks(part))


def _kinks(part: Any) -> tuple[float, ...]:
    """Return the times (s) where the slope of a curve, or of a curve in a condition, jumps."""
    if hasattr(part, "breakpoints"):
        return tuple(part.breakpoints)
    curves = (getattr(part, name) for name in type(part).model_fields)
    return tuple(t for curve in curves if hasattr(curve, "breakpoints") for t in curve.breakpoints)


class Conditions(ConfigModel):
    """Ends of the segment and state at the start."""

    ends: Literal["roller", "clamped", "guided", "free"] = "roller"
    """The end faces slide in their plane (roller), are fixed, move along the axis alone (guided), or carry no load."""
    coupling: Literal["two_way", "one_way"] = "two_way"
    """one_way: the solids move the blood, but on the wall acts only the pressure of the outlet, not the blood's own."""
    initial_state: Literal["preload", "prestress"] = "preload"
    """preload: the geometry is unloaded and the blood inflates it; prestress: it carries the blood pressure already."""
    plane_stress: tuple[str, ...] = ()
    """Regions of a plane solid whose thickness is free (plane stress); in the others it is kept (plane strain)."""
    strain: Literal["finite", "small"] = "finite"
    """small: linear elasticity with the initial moduli of the laws, and loads on the undeformed shape."""
    contact: ContactModel | None = None
    """Lets opposite sides of the lumen touch; the mesh of the blood then moves as the medium between them."""
    skin_displacement: OutlineDisplacement | None = None
    """Moves the skin of a plane section as given, e.g. by registration, instead of the pressure on it."""


class Discretisation(ConfigModel):
    """Polynomial order and mesh motion."""

    order: int = Field(default=2, ge=2, le=6)
    """Order of displacement and velocity; the pressure is one lower."""
    mesh_motion: Literal["harmonic", "elastic"] = "harmonic"
    """How the mesh of the fluid follows the solids: by Laplace's equation, best where a wall surrounds the fluid; or as
    a Neo-Hookean solid that is stiffer where elements are small, for bodies that swing in the flow."""
    bulk_integration: Literal["full", "reduced"] = "full"
    """How the solids' resistance to changes of volume is integrated: reduced, at fewer points, is right for nearly
    incompressible solids (Poisson ratios above 0.49), which lock otherwise."""
    extension_stiffness: float = Field(default=1.0, gt=0)
    """Factor on the equation of the mesh motion, without influence on the result."""
    extra_integration_order: int = Field(default=0, ge=0, le=12)
    """By how much the weak form is integrated to a higher order than usual, to see what that changes."""


SAME_TIME = 1e-9
"""Times closer than this fraction of the nominal step are one."""


MOST_STEPS = 1_000_000
Scheme: TypeAlias = Literal["bdf2", "backward_euler", "static", "esdirk3", "sdirk4"]
"""Names of the time schemes."""


class TimeStepping(ConfigModel):
    """Time scheme and steps."""

    scheme: Scheme = "bdf2"
    """esdirk3, sdirk4: diagonally implicit Runge-Kutta schemes of third and fourth order, in 3 and 5 stages; static: at
    each time the steady state under its loads, all rates zero."""
    step: Time = Field(gt=0)
    """Nominal step, the distance of the rows of series.csv."""
    end: Time = Field(gt=0)
    """When the run ends; it starts at 0."""
    smallest_step: Time = Field(default_factory=lambda given: given["step"] / 64, gt=0)
    """A step that fails is halved down to this; default: a 64th of the step."""
    error_tolerance: float | None = Field(default=None, gt=0, lt=1)
    """Largest estimated error of one step, of displacement and velocity against their scales: a step that exceeds it
    is halved, and grows back to `step` where errors are small. None: steps are shortened on failure alone."""

    @property
    def steps(self) -> int:
        """Number of nominal steps."""
        return ceil(self.end / self.step - SAME_TIME)

    @model_validator(mode="after")
    def _steps_fit(self) -> Self:
        if self.step > self.end:
            raise ValueError(f"the step of {self.step:g} s is longer than the run, which ends at {self.end:g} s")
        if self.end > MOST_STEPS * self.step:
            raise ValueError(f"steps of {self.step:g} s up to {self.end:g} s would be more than {MOST_STEPS:,}")
        if self.error_tolerance is not None and self.scheme in ("backward_euler", "static"):
            raise ValueError("error_tolerance needs 'bdf2', 'esdirk3' or 'sdirk4', whose errors are estimated")
        if self.smallest_step > self.step:
            raise ValueError(f"the smallest step of {self.smallest_step:g} s exceeds the step of {self.step:g} s")
        return self


class Solver(ConfigModel):
    """Newton's method and its linear solver."""

    tolerance: float = Field(default=1e-7, gt=0, lt=1)
    """Largest relative change of any block of unknowns at convergence."""
    max_iterations: int = Field(default=25, ge=1)
    """Iterations after which a step has failed."""
    linearise: Literal["when slow", "always"] = "when slow"
    """when slow: a factorisation serves over iterations and steps until it converges too slowly; always: one per
    iteration, which is Newton's method as in textbooks, to compare with."""
    linear: Literal["auto", "pardiso", "pardiso_single", "umfpack", "mumps", "p_multigrid", "fieldsplit"] = "auto"
    """auto: pardiso where MKL is installed, in large runs pardiso_single while that converges, else umfpack, and
    p_multigrid where that is faster or these do not fit into the memory, as run.log says; mumps on several ranks.
    p_multigrid, and on several ranks fieldsplit, iterate; `ngfsi info` says what each is."""


class Output(ConfigModel):
    """What is written beside the time series."""

    fields_every: int = Field(default=10, ge=0)
    """Steps between two written fields; 0: first and last only."""
    checkpoint_every: int = Field(default=10, ge=0)
    """Steps between two checkpoints, from which a stopped run goes on; 0: by the clock alone."""
    checkpoint_interval: Time = Field(default=300.0, gt=0)
    """Seconds on the clock after which a checkpoint is due in any case."""
    wall_every: int = Field(default=1, ge=1)
    """Steps between two written states of the vein's inner wall, from which TAWSS and OSI follow."""
    stations: int = Field(default=11, ge=2)
    """Number of cross-sections whose outlines and shapes are written with the fields."""
    stability: bool = False
    """Whether the stability of the vein, and the mode in which it would collapse, are written with the fields."""
    low_shear: Pressure = Field(default=0.1, gt=0)
    """Wall shear stress below which an area of the wall counts as of low shear."""


def read_case(path: str | Path) -> tuple[str, dict[str, Any]]:
    """Return the text of a case file, and what it says as TOML.

    Raises:
        CaseError: the file cannot be read, or is not TOML.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        return text, tomllib.loads(text)
    except OSError as error:
        raise CaseError(f"the case file '{path}' cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise CaseError(f"the case file '{path}' is not text in UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        raise CaseError(f"the case file '{path}' is not valid TOML: {error}") from None
    except (ValueError, RecursionError):  # of Python itself, which TOML's parser passes on
        raise CaseError(f"the case file '{path}' holds a number too long or tables too deeply nested") from None


class Case(ConfigModel):
    """One run."""

    format: str = Field(default=FORMAT, pattern=PATTERN)
    """Of this file; `ngfsi migrate` writes files of older formats anew."""
    name: str
    """Of the run and its folder, in letters, digits, '_', '-' and '.'."""
    geometry: Annotated[Any, _AnyGeometry()]
    """What the domain is: a model that is registered by its `type`, and whatever `Domain` needs of it."""
    materials: Materials
    loads: Loads
    conditions: Conditions = Conditions()
    discretisation: Discretisation = Discretisation()
    time: TimeStepping
    solver: Solver = Solver()
    output: Output = Output()
    scalars: tuple[Annotated[ScalarModel, registered("kind", "ngfsi.scalars", ScalarModel)], ...] = ()
    """What the blood carries, without an influence on the flow: scalars by the `kind` under which they are registered.
    """

    @model_validator(mode="before")
    @classmethod
    def _is_of_a_format_that_is_read(cls, data: Any) -> Any:
        """Say so before keys are refused that another format has."""
        if isinstance(data, dict) and FORMAT_KEY in data and (reason := reason_not_read(data[FORMAT_KEY])):
            raise key_error(FORMAT_KEY, reason)
        return data

    @model_validator(mode="after")
    def _each_region_has_a_material(self) -> Self:
        lumens = [vessel.lumen for vessel in self.geometry.vessels if vessel.lumen]
        regions = {kind_of(name) for name in (*self.geometry.solids, *lumens)}
        parts = regions & {*PARTS_OF_TISSUE}
        for name in (one for one in Materials.model_fields if one != "membranes"):
            given = getattr(self.materials, name) is not None
            there = name in regions or (name == "tissue" and parts)
            owned = name in PARTS_OF_TISSUE and self.materials.tissue is not None
            if name in regions and not given and not owned:
                other = ", or materials.tissue for all its tissues" if name in PARTS_OF_TISSUE else ""
                raise key_error(
                    f"materials.{name}", f"is missing: {type(self.geometry).__name__} has such a region{other}"
                )
            if given and not there:
                known = ", ".join(sorted(regions))
                raise key_error(
                    f"materials.{name}", f"is of no region: those of {type(self.geometry).__name__} are {known}"
                )
        return self

    @model_validator(mode="after")
    def _conditions_fit(self) -> Self:
        if wrong := sorted({*self.conditions.plane_stress} - {*self.geometry.solids}):
            raise key_error("conditions.plane_stress", f"names {', '.join(wrong)}: {_solids_of(self.geometry)}")
        alone = self.conditions.plane_stress or self.conditions.strain == "small" or self.conditions.skin_displacement
        if alone and (any(v.lumen for v in self.geometry.vessels) or self.conditions.initial_state == "prestress"):
            raise key_error(
                "conditions", "has plane_stress, small strain or a skin_displacement: these are for solids "
                "without fluid, from their unloaded shape (initial_state = \"preload\")"
            )  # fmt: skip
        return self

    @model_validator(mode="after")
    def _sides_can_touch(self) -> Self:
        walls = self.geometry.solids and any(v.lumen for v in self.geometry.vessels)
        if self.conditions.contact and not walls:
            name = type(self.geometry).__name__
            raise key_error("conditions.contact", f"is for blood within solids, whose mesh it presses: {name} has none")
        return self

    @model_validator(mode="after")
    def _scalars_are_carried(self) -> Self:
        if self.scalars and not any(v.lumen for v in self.geometry.vessels):
            raise key_error("scalars", f"are carried by blood: {type(self.geometry).__name__} has none")
        if reason := check_names(self.scalars):
            raise key_error("scalars", reason)
        return self

    @model_validator(mode="after")
    def _coupling_fits(self) -> Self:
        walls = self.geometry.solids and any(v.lumen and v.centreline for v in self.geometry.vessels)
        if self.conditions.coupling == "one_way" and not walls:
            raise key_error(
                "conditions.coupling", f'is "one_way", which is for veins in tissue: {type(self.geometry).__name__} '
                "is none"
            )  # fmt: skip
        return self

    @field_validator("name")
    @classmethod
    def _names_a_folder(cls, name: str) -> str:
        if not re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9_.-]*", name):
            raise ValueError(f"'{name}' cannot name a folder: use letters, digits, '_', '-' and, but not first, '.'")
        return name

    @classmethod
    def from_toml(cls, path: str | Path) -> Self:
        """Return the case in a TOML file, beside which the files are that it names by a relative path.

        Raises:
            CaseError: the file cannot be read, is not TOML, or a key or value in it is refused.
        """
        _, data = read_case(path)
        _place_files(data, Path(path).absolute().parent)
        try:
            return cls.from_dict(data, source=str(path))
        except NgfsiError as error:
            if FORMAT_KEY in data or not is_older(data):
                raise
            advice = f"the file is of an older format: `ngfsi migrate {path}` writes it anew"
            raise type(error)(f"{error}; {advice}") from None

    def to_toml_dict(self) -> dict[str, Any]:
        """Return plain tables, lists and scalars with SI keys, from which `from_dict` gives an equal case."""
        written = super().to_toml_dict()
        written["geometry"] = {"type": name_of(type(self.geometry)), **written["geometry"]}
        return written

    def to_toml(self) -> str:
        """Return the text of a case file with every value resolved, from which `from_toml` gives an equal case."""
        return tomli_w.dumps(self.to_toml_dict())

    @property
    def content(self) -> dict[str, Any]:
        """Everything but name and format: equal for cases that must give equal results."""
        return {key: value for key, value in self.to_toml_dict().items() if key not in ("name", FORMAT_KEY)}

    @property
    def digest(self) -> str:
        """SHA-256 of the content."""
        return hashlib.sha256(json.dumps(self.content, sort_keys=True).encode()).hexdigest()


def _place_files(data: Any, folder: Path) -> None:
    """Make the files named in tables, whose key is `file`, those in a folder, unless their paths are absolute."""
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        if key == "file" and isinstance(value, str) and value:
            data[key] = str(folder / value)
        elif isinstance(value, dict | list):
            _place_files(value, folder)


def _solids_of(geometry: Any) -> str:
    return f"the solids of {type(geometry).__name__} are {', '.join(sorted(geometry.solids))}"
