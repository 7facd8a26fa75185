"""What every material law is: a model with a tag `law`, a density, a label and provenance."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from ngfsi.config.model import ConfigModel
from ngfsi.errors import MaterialError, NgfsiError
from ngfsi.units import Density


class Law(ConfigModel):
    """A material of one region: common to solids and fluids."""

    refusal: ClassVar[type[NgfsiError]] = MaterialError
    formula: ClassVar[str]
    """The law in LaTeX."""
    source: ClassVar[str]
    """Where the law comes from."""

    law: str
    """Tag of the law, its name in case files."""
    density: Density
    """Mass per reference volume (kg/m3)."""
    label: str = Field(default_factory=lambda given: given.get("law", ""))
    """How tables and figures call the material: the name of the parameter set, else of the law."""
