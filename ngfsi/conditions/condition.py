"""What acts on the system: one object for each load, opening, support and prescribed motion.

A condition is given by a model, which a case file holds, or is made in Python. The system sums what its conditions
contribute, and asks nothing else of them:

    boundary conditions of the spaces   `fixes`, `velocity_on`, `own_unknowns`, before there are unknowns
    integrals of the weak form          `integrals`, and `static_integrals` of the solids at rest
    values of prescribed unknowns       `prescribed`, `prescribe`
    course in time                      `update`, `accept`, and `state_arrays` for checkpoints and other ranks
    what is measured and said of it     `columns`, `sentence`; its power follows from its integrals (measure/energy.py)
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import Parameter

from ngfsi.arrays import Array, Numbers
from ngfsi.config.model import ConfigModel
from ngfsi.errors import CaseError
from ngfsi.materials.fluid.law import FluidLaw
from ngfsi.mesh.domain import Domain
from ngfsi.mesh.geometry import Vessel
from ngfsi.physics.fields import MOTION, Fields, Named
from ngfsi.physics.integrals import Integral


@dataclass(frozen=True)
class Setup:
    """What a condition is attached to.

    Attributes:
        domain: the reference shape.
        unknowns: of the system (`ngfsi.system.unknowns.Unknowns`).
        trial, test, state: by name of the field.
        velocity_history: by name of the field; rate(y) = new_weight y + history.
        fields: of the blood and the mesh, as functions of trial functions or of the state.
        new_weight: of the new state in the rates (1/s); 0 at rest.
        blood_density: kg/m3; grows to its value while the first steady flow is found.
        references: by vessel what sets the reference pressure of its blood.
        fluid: law of the blood; None: there is none.
        densities: of the solids (kg/m3), by region.
        stiffness: of the solids (Pa), as a scale.
        small: whether strains are small, and loads act on the undeformed shape.
        leads: whether this process has the integrals on boundaries.
    """

    domain: Domain
    unknowns: Any
    trial: Named
    test: Named
    state: Named
    velocity_history: Named
    fields: Callable[[Named], Fields]
    new_weight: Parameter
    blood_density: Parameter
    references: Mapping[str, WithValue]
    fluid: FluidLaw | None
    densities: Mapping[str, float]
    stiffness: float = 1.0
    small: bool = False
    leads: bool = True


class Condition:
    """Base of all conditions: one that does nothing.

    Attributes:
        name: distinguishes it from the others of a system.
    """

    name: str = ""
    _setup: Setup

    def fixes(self) -> Mapping[str, Sequence[str]]:
        """Return the boundaries whose displacement is prescribed: "" for all components, or "x", "y", "z"."""
        return {}

    def points(self, _motion: Any) -> Sequence[int]:
        """Return further unknowns of the motion's space that are zero, so that with its `fixes` nothing can move
        rigidly, unless others support the solids."""
        return ()

    def supports(self) -> bool:
        """Whether it resists all rigid motions of the solids: by default where it fixes a boundary."""
        return bool(self.fixes().get(""))

    def velocity_on(self) -> Sequence[str]:
        """Return the openings on which the relative velocity is prescribed."""
        return ()

    def own_unknowns(self) -> Mapping[str, float]:
        """Return the names of scalar unknowns of its own, and the scale against which their changes are judged (SI)."""
        return {}

    def excludes_blood(self) -> bool:
        """Whether the blood's terms are left out of the equations of the solids (one-way coupling)."""
        return False

    def columns(self) -> Mapping[str, Callable[[], float]]:
        """Return what it adds to series.csv: column, its unit last, -> what returns its present value (SI)."""
        return {}

    def moves_mesh(self) -> bool:
        """Whether it moves the mesh of the blood, in place of `discretisation.mesh_motion`, as a medium in equilibrium
        with the wall: the same terms tested with the motion and with the velocity."""
        return False

    def gaps(self) -> Array:
        """Return the present distances of what must not meet, over those at the start, at points in a fixed order: by
        them the time loop sees that a step would be too long."""
        return np.zeros(0)

    def attach(self, setup: Setup) -> None:
        """Take what it acts on; its integrals are asked for afterwards. What overrides this calls it, too."""
        self._setup = setup

    def integrals(self, _elements: ng.BitArray | None) -> list[Integral]:
        """Return its terms of the weak form, internal minus external virtual work, on some elements or all (None).

        By default those for the solids at rest, at the present motion.
        """
        setup = self._setup
        return self.static_integrals(setup.trial[MOTION], setup.test[MOTION]) if setup.leads else []

    def integrals_of(self, _fields: Fields, _test: Named, _elements: ng.BitArray | None) -> list[Integral] | None:
        """Return its terms, all of them part of the blood's balance of momentum, as functions of the blood's fields and
        test functions alone; None: some are not, and `integrals` and `blood_integrals` are to be asked. A residual made
        of the former takes less time."""
        return None

    def blood_integrals(self, _elements: ng.BitArray | None) -> list[Integral]:
        """Return those of its terms that are part of the blood's balance of momentum."""
        return []

    def static_integrals(self, _m: Any, _v: Any) -> list[Integral]:
        """Return its terms for the solids at rest, as functions of a motion m and its test function v."""
        return []

    def prescribed(self) -> Numbers:
        """Return the numbers of the unknowns that it prescribes with values of their own, in the whole vector."""
        return np.zeros(0, dtype=np.int64)

    def prescribe(self, values: Array) -> None:
        """Write the values of the prescribed unknowns into a vector, for the present shape."""

    def pull_back(self, _factors: Array) -> Array | None:
        """Return the derivative of a weighted sum of the prescribed values by all unknowns, of whose present values
        they may depend; None: they do not. Gradients ask for it (ngfsi/gradient).

        Args:
            factors: of the prescribed values, in the whole vector.
        """
        return None

    def followers(self) -> list[tuple[Parameter, Array]]:
        """Return the numbers in its integrals that follow the state, with their derivatives by all unknowns in the
        present state; gradients ask for them."""
        return []

    def update(self, t: float, load_factor: float = 1.0) -> None:
        """Take the value at time t (s), or a fraction of it (`load_factor`, from 0 to 1)."""

    def accept(self) -> None:
        """Take note that the present state is accepted, and a new step begins."""

    def state_arrays(self) -> dict[str, Array]:
        """Return copies of all that it depends on beside case and state, for `restore_state`."""
        return {}

    def restore_state(self, arrays: Mapping[str, Array]) -> None:
        """Take what `state_arrays` of an equal condition returned."""

    def flow_scale(self) -> float:
        """Return a flow (m3/s) that it drives, as a scale; 0: none."""
        return 0.0

    def pressure_scale(self) -> float:
        """Return a pressure (Pa) that it puts on the blood, as a scale; 0: none."""
        return 0.0

    def sentence(self) -> str:
        """Return what acts now, for reports and failures, e.g. "3333 Pa on the skin"; empty: nothing to be said."""
        return ""


class WithValue(Condition):
    """A condition whose course in time is one number."""

    def __init__(self, name: str, curve: Callable[[float], float]) -> None:
        """Prepare; `curve`: value (SI) over time (s)."""
        self.name, self.curve, self.value = name, curve, Parameter(0.0)

    def update(self, t: float, load_factor: float = 1.0) -> None:
        self.value.Set(load_factor * self.curve(t))

    def state_arrays(self) -> dict[str, Array]:
        return {"value": np.array([self.value.Get()])}

    def restore_state(self, arrays: Mapping[str, Array]) -> None:
        self.value.Set(float(arrays["value"][0]))


class ConditionModel(ConfigModel):
    """A condition as a case file holds it; its `kind` is the name under which it is registered (`ngfsi.conditions`)."""

    kind: str
    """Its name."""

    @abstractmethod
    def condition(self, domain: Domain, name: str) -> Condition:
        """Return the condition.

        Args:
            name: given by the place in the case file.

        Raises:
            CaseError: it does not fit the geometry.
        """


def check_components(vector: Sequence[float], what: str, name: str, domain: Domain) -> None:
    """Refuse a vector that has not a component for each axis.

    Raises:
        CaseError: says so of what it is, in the condition of a name.
    """
    if len(vector) != domain.mesh.dim:
        raise CaseError(f"loads.further: {name}: the {what} needs {domain.mesh.dim} components, not {len(vector)}")


class OpeningModel(ConfigModel):
    """The condition at an opening as a case file holds it; registered by its `kind` (`ngfsi.openings`)."""

    kind: str
    """Its name."""

    @abstractmethod
    def condition(self, domain: Domain, opening: str, vessel: Vessel) -> Condition:
        """Return the condition at an opening of a vessel."""

    def reference(self) -> Callable[[float], float] | None:
        """Return a known pressure (Pa over s) of the blood here, relative to which the vessel's pressure is solved for;
        None: there is none."""
        return None
