"""Membranes: thin stiff layers on boundaries, such as skin, fascia and the interosseous membrane."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple, Self

from pydantic import Field, model_validator

from ngfsi.config.messages import key_error
from ngfsi.config.model import ConfigModel
from ngfsi.errors import MaterialError, NgfsiError
from ngfsi.materials.from_case import SolidMaterial
from ngfsi.materials.parameter_sets import load_set
from ngfsi.units import Length


class Usual(NamedTuple):
    """Thickness (m) and parameter set of a membrane by its name."""

    thickness: float
    set: str


USUAL = {
    "skin": Usual(1.2e-3, "skin"),
    "fascia": Usual(0.924e-3, "crural_fascia"),
    "interosseous_membrane": Usual(0.924e-3, "crural_fascia"),
}
"""The crural fascia's is the mean of ten legs (C. Stecco et al., Surg Radiol Anat 31 (2009) 523), which is taken for
the interosseous membrane, too, of which no measurement was found; that of the skin is an assumption."""


def _material(given: dict[str, Any]) -> Any:
    usual = USUAL.get(given.get("on", ""))
    return load_set(usual.set) if usual else None


def _thickness(given: dict[str, Any]) -> float:
    usual = USUAL.get(given.get("on", ""))
    return usual.thickness if usual else 0.0


class Membrane(ConfigModel):
    """A layer so thin that it has forces in its plane alone, which does not change its volume."""

    refusal: ClassVar[type[NgfsiError]] = MaterialError

    on: str
    """Name of a boundary, around solids or between them."""
    thickness: Length = Field(default_factory=_thickness, gt=0)
    """In the given shape; usual ones are known of skin, fascia and interosseous_membrane."""
    material: SolidMaterial = Field(default_factory=_material)
    """A usual one is known of the same."""
    stretch: float = Field(default=1.0, gt=0)
    """In both directions of its plane, in the given shape, against the one in which it is free of stress."""

    @model_validator(mode="after")
    def _is_known(self) -> Self:
        for key in ("thickness", "material"):
            if not getattr(self, key):
                written = "thickness_mm" if key == "thickness" else key
                raise key_error(written, f"is missing: usual ones are known of {', '.join(USUAL)}")
        if self.material.viscosity is not None:
            raise key_error("material", "has a viscosity, which membranes have not: leave it out")
        return self
