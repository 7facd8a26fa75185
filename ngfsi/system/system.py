"""The coupled system: residual and linearisation of solids, blood and mesh motion in one vector of unknowns.

It sums what solids, blood and conditions contribute, and knows none of the conditions in particular.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from typing import Any, ClassVar

import ngsolve as ng
import numpy as np
from ngsolve import GridFunction, Inv, Parameter

from ngfsi.arrays import Array, Mask, part_of
from ngfsi.case import Case
from ngfsi.conditions.condition import Condition, Setup
from ngfsi.errors import CaseError
from ngfsi.materials.fluid.law import FluidLaw
from ngfsi.materials.solid.law import Place, SolidModel
from ngfsi.materials.solid.small_strain import SmallStrain
from ngfsi.mesh.domain import Domain, elements_at, faces_of
from ngfsi.mesh.geometry import Vessel
from ngfsi.parallel.ranks import SERIAL, Distribution, Ranks
from ngfsi.parallel.stopwatch import Stopwatch
from ngfsi.physics import terms
from ngfsi.physics.fields import MOTION, PRESSURE, STRETCH, VELOCITY, Fields, Named
from ngfsi.physics.integrals import Integral, form_rules, reduced_rules, rules
from ngfsi.physics.kinematics import Kinematics, in_3d
from ngfsi.system.conditions import conditions_of, references_of
from ngfsi.system.forms import Part, PartOfBlood, WithInertia, WithoutRows, WithParts, residual_form, tangent_form
from ngfsi.system.schemes import STEADY, Weights
from ngfsi.system.unknowns import Unknowns

EXTRA_ORDER = 1
"""Integration order of the blood's terms beyond twice that of the elements, for the lumen's balance of mass,
cof(F) : grad u. It is free on hexahedra of order 2, and the balance closes to 1e-7 of the flow; 2 closes it to
rounding, but doubles the cost of the Jacobian and changes the mean wall shear by 6e-4. Tetrahedra of order 2 do without
(`form_rules`): that changes the mean wall shear by 4e-4, too, and the balance not at all."""
SLOWEST = 0.01
"""Flow by which changes of the velocity are judged at least while the solids move, over the blood's volume (1/s)."""
BEFORE = "before"
"""Name of the last accepted state among what is stored, where a model of a solid needs it."""
FEW = 0.25
"""Fraction of a vector's entries below which other ranks are sent those that have changed instead of all."""
ROUNDING = 1e-13
"""Forces below this fraction of modulus times size squared are rounding: those of a nanopascal on the skin."""


def second_rate(new: Any, state: Any, velocity_history: Any, acceleration_history: Any) -> Any:
    """Return the rate of the rate of a state, as arrays or coefficient functions."""
    return new * (new * state + velocity_history) + acceleration_history


class System:
    """Weak form of a case on a domain, with its state, its rates and its conditions.

    Rates are linear in the state: rate(y) = new * y + history. `velocity_history` and `acceleration_history` hold
    the old states' part for each unknown, in the same vector layout as the state itself.

    Attributes:
        conditions: what acts, by name.
        solids: the models of the solids, by region.
        step: size of the step that is being taken (s); infinite at rest.
    """

    condenses: ClassVar[bool] = True
    """Whether interior unknowns are eliminated from the tangent, where elements have any."""

    def __init__(
        self, case: Case, domain: Domain, watch: Stopwatch | None = None, ranks: Ranks = SERIAL,
        elements: ng.BitArray | None = None, more: Sequence[Condition] = (),
    ) -> None:  # fmt: skip
        """Build the forms.

        Args:
            watch: takes the seconds of residuals, assembly, factorisation and solves.
            ranks: that work on the same case together.
            elements: those of which this rank has the integrals; default: all.
            more: conditions beyond those of the case; one at an opening takes the place of the case's.

        Raises:
            CaseError: a condition does not fit the geometry, or an opening has none.
        """
        self.case, self.domain, self.ranks = case, domain, ranks
        self.watch = watch or Stopwatch()
        self._elements = elements
        references = references_of(case, domain)
        acting = [*references.values(), *conditions_of(case, domain, {one.name for one in more}), *more]
        self.conditions = {condition.name: condition for condition in acting}
        if len(self.conditions) < len(acting):
            raise CaseError(f"two conditions have the same name, there are {', '.join(c.name for c in acting)}")
        self.unknowns = Unknowns.build(domain, case.discretisation.order, acting, case.conditions.plane_stress)
        space = self.unknowns.space
        self._trial, self._test = map(self.unknowns.named, space.TnT())
        self.state, self.velocity_history, self.acceleration_history = (GridFunction(space) for _ in range(3))
        self.new_weight, self.step = Parameter(0.0), Parameter(np.inf)
        self.blood_density = Parameter(self.blood.density if domain.lumens else 0.0)
        self._parameters = self.new_weight, self.step, self.blood_density
        self.motion = self.state.components[0]
        self.relaxation: GridFunction | None = None
        self._stored = {"state": self.state, "velocity_history": self.velocity_history,
                        "acceleration_history": self.acceleration_history}  # fmt: skip
        if case.conditions.initial_state == "prestress":
            self.relaxation = self._stored["relaxation"] = GridFunction(space.components[0])
        self._small = case.conditions.strain == "small"
        self.solids = {name: self._model(name) for name in domain.geometry.solids}
        self._volume = domain.volume(*domain.lumens) if domain.lumens else 0.0
        self._areas = {name: domain.area(name) for v in domain.vessels if v.lumen for name in v.openings}
        setup = self._setup(references)
        for condition in acting:
            condition.attach(setup)
        self.form, self.tangent = self._forms(space)
        self._residual = self.state.vec.CreateVector()
        self._last_sent: dict[str, Array] = {}
        self._received: dict[str, Array] = {}
        self._enrolled: list[Any] = []

    def _setup(self, references: Mapping[str, Any]) -> Setup:
        return Setup(
            domain=self.domain, unknowns=self.unknowns, trial=self._trial, test=self._test,
            state=self.named(self.state), velocity_history=self.named(self.velocity_history), fields=self.fields,
            new_weight=self.new_weight, blood_density=self.blood_density, references=references,
            fluid=self.case.materials.fluid, densities={name: one.density for name, one in self.solids.items()},
            stiffness=self._stiffness(),
            small=self._small, leads=self.ranks.leads,
        )  # fmt: skip

    def _stiffness(self) -> float:
        """Return the largest shear modulus of the solids (Pa)."""
        laws = (self.case.materials.law_of(name) for name in self.domain.geometry.solids)
        return max((law.shear_modulus or 0.0 for law in laws), default=1.0)

    def _model(self, region: str) -> SolidModel:
        law = self.case.materials.law_of(region)
        if self._small:
            return SmallStrain(law.at(self.domain, region))
        F = self._gradient(self.state, region)
        order, rate = self.unknowns.order, partial(self._rate, region)
        return law.model(Place(self.domain, region, order, F, self.step, partial(self._before, region), rate))

    def _before(self, region: str) -> Any:
        """Return F of a solid in the last accepted state, which is kept from now on."""
        return self._gradient(self._stored.setdefault(BEFORE, GridFunction(self.unknowns.space)), region)

    def _rate(self, region: str, F: Any) -> Any:
        """Return dF/dt (1/s) of a solid for an F at the end of the step."""
        history, relaxation = self.velocity_history, self.stress_free_gradient()
        start, old = ng.Id(self.domain.mesh.dim), ng.Grad(history.components[0])
        if relaxation is not None:
            start, old = relaxation, old * relaxation
        across = self.named(history)[STRETCH] if region in self.case.conditions.plane_stress else 0
        return self.new_weight * (F - in_3d(start, 1)) + in_3d(old, across)

    def _gradient(self, state: GridFunction, region: str) -> Any:
        """Return F (3x3) of a solid in a state, from the shape free of stress, with the stretch across the plane."""
        F, relaxation = Kinematics(ng.Grad(state.components[0])).F, self.stress_free_gradient()
        across = 1 + self.named(state)[STRETCH] if region in self.case.conditions.plane_stress else 1
        return in_3d(F if relaxation is None else F * relaxation, across)

    def named(self, field: GridFunction) -> dict[str, Any]:
        """Return the components of a grid function of all unknowns by name of the field."""
        return self.unknowns.named(field.components)

    @property
    def blood(self) -> FluidLaw:
        """The law of the blood, of a system that has any."""
        assert self.case.materials.fluid is not None
        return self.case.materials.fluid

    # ---------------------------------------------------------------- weak form

    def _forms(self, space: Any) -> tuple[Any, Any]:
        """Return residual and tangent.

        With one-way coupling the blood's terms are missing in the equations of the solids, where they are its traction.
        """
        return self._residual_form(space), self._tangent_form(space)

    @property
    def _one_way(self) -> bool:
        return any(condition.excludes_blood() for condition in self.conditions.values())

    def _residual_form(self, space: Any) -> Any:
        parts, left = list[Part](), list(self.conditions.values())
        if self.domain.lumens:
            part, left = self._blood_part(self._elements)
            parts.append(part)
        acting = [one for condition in left for one in condition.integrals(self._elements)]
        if self.case.conditions.plane_stress:
            acting += self.works(self._trial)
        elif self.solids:
            parts.append(self._solids_part())
        residual: Any = WithParts(residual_form(space, acting), parts)
        if self._one_way:
            blood = residual_form(space, self.blood_integrals(self._elements))
            residual = WithoutRows(residual, blood, self.unknowns.blocks["d"])
        return self._with_inertia(residual)

    def _solids_part(self) -> Part:
        """Return the residual of the solids' stresses."""
        where = self.unknowns.within(self.domain, list(self.solids), (MOTION,))
        trial, test = where.space.TnT()
        return Part(where, self.works({MOTION: trial}, {MOTION: test}))

    def _blood_part(self, elements: ng.BitArray | None) -> tuple[Part, list[Condition]]:
        """Return the residual of the blood, on some elements or all, with what conditions add to it, and the conditions
        that need more."""
        where = self.unknowns.within(self.domain, self.domain.lumens, (MOTION, VELOCITY, PRESSURE), vectors=2)
        (m, w, p, u, a), (v, v_mesh, q, *_) = where.space.TnT()
        fields = Fields(m, ng.Grad(m), ng.Grad(u) - ng.Grad(w), w, u, ng.Grad(u), acceleration=a, pressure=p)
        test = {MOTION: v, VELOCITY: v_mesh, PRESSURE: q}
        found, left = self._blood_inside(fields, test, elements), []
        for condition in self.conditions.values():
            terms_of = condition.integrals_of(fields, test, elements)
            if terms_of is None:
                left.append(condition)
            found += terms_of or []
        histories = (np.asarray(field.vec.FV().NumPy()) for field in (self.velocity_history, self.acceleration_history))
        return PartOfBlood(where, found, self.new_weight, *histories), left

    def _tangent_form(self, space: Any) -> Any:
        thins, one_way = bool(self.domain.lumens) and not self.blood.newtonian, self._one_way
        linear = [*self.integrals(linearised=thins), *self.inertia_integrals(self._acceleration, self._test[MOTION])]
        # interior unknowns appear from order 3 on
        condense = self.condenses and self.unknowns.order >= 3 and not one_way
        tangent: Any = tangent_form(space, linear, condense=condense)
        if one_way:
            blood = self.blood_integrals(self._elements, linearised=thins)
            tangent = WithoutRows(tangent, tangent_form(space, blood), self.unknowns.blocks["d"])
        return tangent

    @property
    def _acceleration(self) -> Any:
        """The acceleration of the solids, of trial functions."""
        velocity, rest = (field.components[0] for field in (self.velocity_history, self.acceleration_history))
        return second_rate(self.new_weight, self._trial[MOTION], velocity, rest)

    def _with_inertia(self, residual: Any) -> WithInertia:
        motion = self.unknowns.space.components[0]
        trial, test = motion.components[0].TnT()
        mass = tangent_form(motion.components[0], self.inertia_integrals(trial, test))
        velocity, rest = (field.vec.FV().NumPy() for field in (self.velocity_history, self.acceleration_history))

        def acceleration(values: Array) -> Array:
            return np.asarray(second_rate(self.new_weight.Get(), values, velocity, rest))

        return WithInertia(residual, mass, motion, acceleration)

    def fields(self, parts: Named | None = None) -> Fields:
        """Return the blood's and the mesh's fields of the present state, or of trial functions by name."""
        histories = self.named(self.velocity_history), self.named(self.acceleration_history)
        return Fields.of(self.named(self.state) if parts is None else parts, *histories, self.new_weight)

    def deformation_gradient(self) -> Any:
        """Return F of the solids in the present state, from the shape that is free of stress."""
        F, relaxation = Kinematics(ng.Grad(self.motion)).F, self.stress_free_gradient()
        return F if relaxation is None else F * relaxation

    def deformation_gradient_3d(self) -> dict[str, Any]:
        """Return F of each solid as a tensor in 3-D, with the stretch across the plane."""
        return {name: self._gradient(self.state, name) for name in self.solids}

    def stress_free_gradient(self) -> Any | None:
        """G = dX/dX0 where the reference shape is prestressed: inverse of I + grad(X0 - X)."""
        return None if self.relaxation is None else Inv(Kinematics(ng.Grad(self.relaxation)).F)

    def blood_form(self, vessel: Vessel | None = None) -> WithParts:
        """Return the residual of the blood alone: what it lacks at a boundary is the force on that boundary.

        Args:
            vessel: of this rank's elements that touch its wall, instead of all elements.
        """
        near = None
        if vessel is not None:
            near = elements_at(self.domain, str(vessel.lumen), vessel.interface)
            if self._elements is not None:
                near &= self._elements
        part, left = self._blood_part(near)
        acting = [one for condition in left for one in condition.blood_integrals(near)]
        return WithParts(residual_form(self.unknowns.space, acting), [part])

    def integrals(self, *, linearised: bool = False) -> list[Integral]:
        """Return the integrals of the weak form but the solids' inertia, on this rank's elements.

        Args:
            linearised: for the tangent, in which the viscosity of blood that thins has half of its derivative.
        """
        acting = [one for condition in self.conditions.values() for one in condition.integrals(self._elements)]
        found = [*self.works(self._trial), *acting]
        if self.domain.lumens:
            found += self._blood_inside(self.fields(self._trial), self._test, self._elements, linearised)
        return found

    def works(self, fields: Named, test: Named | None = None) -> list[Integral]:
        """Return the virtual work of the solids' stresses, of trial functions or the present state by name.

        Args:
            test: test functions by name; default: the system's.
        """
        test = self._test if test is None else test
        F, relaxation, found = Kinematics(ng.Grad(fields[MOTION])).F, self.stress_free_gradient(), []
        for name in self.solids:
            # the stretch across the plane and its variation
            stressed = name in self.case.conditions.plane_stress
            across = (1 + fields[STRETCH], test[STRETCH]) if stressed else (1, 0)
            found += self.work_integrals(name, F, ng.Grad(test[MOTION]), relaxation, across, self._elements)
        return found

    def _rules(self, beyond: int = 0) -> dict[Any, ng.IntegrationRule]:
        return form_rules(self.unknowns.order, beyond, self.case.discretisation.extra_integration_order)

    def blood_pressure(self, vessel: str = "") -> Any:
        """Return the pressure of the blood (Pa) in a vessel, in the present state."""
        return self.named(self.state)[PRESSURE] + self.reference(vessel)

    def reference(self, vessel: str = "") -> Parameter:
        """Return the pressure (Pa) relative to which that of a vessel's blood is solved for."""
        condition: Any = self.conditions[f"blood {vessel}".strip()]
        return condition.value

    def viscosity(self) -> Any:
        """Return the viscosity of the blood (Pa s) in the present state."""
        f = self.fields()
        L = f.grad_velocity * Kinematics(f.grad_motion).inverse
        return self.blood.apparent_viscosity(L + L.trans)

    def hydrostatic_pressure(self, region: str) -> Any:
        """Return p = -tr(sigma)/3 (Pa) of a solid in the present state."""
        model, F = self.solids[region], self.deformation_gradient_3d()[region]
        return -model.variation(F, ng.Id(3)) / 3 if self._small else terms.hydrostatic_pressure(model, F)

    def cauchy_stress(self, region: str) -> Any:
        """Return sigma (Pa, 3x3) of a solid in the present state."""
        return terms.cauchy_stress(self.solids[region], self.deformation_gradient_3d()[region], small=self._small)

    def work_integrals(
        self, name: str, F: Any, grad_v: Any, relaxation: Any | None, across: tuple[Any, Any] = (1, 0),
        elements: ng.BitArray | None = None, *, at_rest: bool = False,
    ) -> list[Integral]:  # fmt: skip
        """Return the virtual work of a solid's stresses, or those left at rest, at all integration points first."""
        order, model = self.unknowns.order, self.solids[name]
        model = model.at_rest if at_rest else model
        dx = partial(self.domain.dx, name, definedonelements=elements)
        measure = dx(intrules=self._rules())
        if self.case.discretisation.bulk_integration == "full":
            return [Integral([terms.internal_work(model, F, grad_v, relaxation, across)], measure)]
        rest, bulk = terms.internal_works(model, F, grad_v, relaxation, across)
        return [Integral([rest], measure), Integral([bulk], dx(intrules=reduced_rules(order)))]

    def inertia_integrals(self, acceleration: Any, v: Any) -> list[Integral]:
        """Return the integrals of the solids' inertia, for one component or all of an acceleration."""
        order = 2 * self.unknowns.order + self.case.discretisation.extra_integration_order
        more = {"definedonelements": self._elements, "intrules": rules(order)}
        return [Integral([terms.inertia(model.density, acceleration, v)], self.domain.dx(name, **more))
                for name, model in self.solids.items()]  # fmt: skip

    def static_integrals(self, m: Any, v: Any) -> list[Integral]:
        """Return the integrals of the solids at rest under what acts now, the blood's pressure held as it is.

        Args:
            m, v: motion and test function of the space of the motion alone.
        """
        F, relaxation = Kinematics(ng.Grad(m)).F, self.stress_free_gradient()
        found = [i for name in self.solids
                 for i in self.work_integrals(name, F, ng.Grad(v), relaxation, at_rest=True)]  # fmt: skip
        return [*found, *(i for condition in self.conditions.values() for i in condition.static_integrals(m, v))]

    def blood_integrals(self, elements: ng.BitArray | None = None, *, linearised: bool = False) -> list[Integral]:
        """Return the integrals of the blood, the mesh motion and what acts on the blood, on some elements or all."""
        acting = [i for condition in self.conditions.values() for i in condition.blood_integrals(elements)]
        if not self.domain.lumens:
            return acting
        return [*self._blood_inside(self.fields(self._trial), self._test, elements, linearised), *acting]

    def _blood_inside(
        self, f: Fields, test: Named, elements: ng.BitArray | None, linearised: bool = False
    ) -> list[Integral]:
        k = Kinematics(f.grad_motion)
        # which unknown's equation that makes: see Unknowns.equations
        v, v_mesh = test[MOTION], test[VELOCITY]
        held = self.viscosity() if linearised and not self.blood.newtonian else None
        inside = [
            terms.convective_inertia(self.blood_density, k, f.acceleration, f.grad_velocity, f.relative, v),
            terms.fluid_stress_work(self.blood, k, f.grad_velocity, f.pressure, ng.Grad(v), held),
            terms.incompressibility(k, f.grad_velocity, test[PRESSURE]),
        ]
        if not any(condition.moves_mesh() for condition in self.conditions.values()):
            inside.append(self._extension(k, f.grad_motion, ng.Grad(v_mesh)))
        points = self._rules(EXTRA_ORDER)
        return [Integral(inside, self.domain.dx(*self.domain.lumens, intrules=points, definedonelements=elements))]

    def _extension(self, k: Kinematics, grad_m: Any, grad_v: Any) -> Any:
        stiffness = self.case.discretisation.extension_stiffness
        if self.case.discretisation.mesh_motion == "harmonic":
            return terms.harmonic_extension(stiffness, grad_m, grad_v)
        stiffness *= (self.domain.geometry.size / ng.specialcf.mesh_size) ** 2
        return terms.elastic_extension(stiffness, k, grad_v)

    # ---------------------------------------------------------------- state, conditions, rates

    @property
    def values(self) -> Array:
        """The state's vector of unknowns, as a view."""
        return np.asarray(self.state.vec.FV().NumPy())

    def enrol(self, one: Any) -> int:
        """Return the number of an object that all ranks make by the same calls (see `OnAllRanks`)."""
        if self.ranks.size > 1:
            self._enrolled.append(one)
        return len(self._enrolled) - 1

    def enrolled(self, number: int) -> Any:
        """Return the object of a number."""
        return self._enrolled[number]

    def mine(self, kind: Any) -> ng.BitArray | None:
        """Return this rank's elements of the mesh (VOL) or of its boundary (BND); None: all."""
        return self._elements if kind == ng.VOL else self._faces

    @cached_property
    def _faces(self) -> ng.BitArray | None:
        return None if self._elements is None else faces_of(self.domain, self._elements)

    def prescribe(self) -> None:
        """Write the values of prescribed unknowns, which may depend on the present shape."""
        for condition in self.conditions.values():
            condition.prescribe(self.values)

    def update(self, t: float, load_factor: float = 1.0) -> None:
        """Let what acts at time t (s) act, or a fraction of it."""
        for condition in self.conditions.values():
            condition.update(t, load_factor)

    def set_rates(self, weights: Weights, states: tuple[Array, Array], rates: tuple[Array, Array], step: float) -> None:
        """Take the weights of a step of a size (s), and the histories of (last, second last) states and rates."""
        self.set_step(step)
        self.new_weight.Set(weights.new)
        self.velocity_history.vec.FV().NumPy()[:] = weights.old * states[0] + weights.older * states[1]
        self.acceleration_history.vec.FV().NumPy()[:] = weights.old * rates[0] + weights.older * rates[1]

    def set_step(self, size: float) -> None:
        """Take the size of the step that is being taken (s)."""
        self.step.Set(size)
        for model in self.solids.values():
            model.take_step(size)

    def set_steady(self) -> None:
        """Let all rates vanish."""
        zero = np.zeros(self.unknowns.size)
        self.set_rates(STEADY, (zero, zero), (zero, zero), np.inf)

    def accept(self) -> None:
        """Take note that the present state is accepted, and a new step begins."""
        for _, part in self._with_memory():
            part.accept()
        if before := self._stored.get(BEFORE):
            before.vec.data = self.state.vec

    def remember(self, memory: Mapping[str, Array], before: Array | float) -> None:
        """Take what solids remember, by its name in snapshots, and the last accepted state."""
        for name, model in self.solids.items():
            model.restore_state(part_of(memory, f"model {name}"))
        if field := self._stored.get(BEFORE):
            field.vec.FV().NumPy()[:] = before

    def new_memory(self) -> dict[str, Array]:
        """Return what solids will remember of the present state if it is accepted, by its name in snapshots."""
        return {f"model {name}.{key}": np.ravel(one.updated().FV().NumPy()) for name, model in self.solids.items()
                for key, one in model.internal_variables().items()}  # fmt: skip

    def _with_memory(self) -> list[tuple[str, Any]]:
        """Return conditions and models, which may depend on more than case and state, by name."""
        conditions = [(f"condition {name}", one) for name, one in self.conditions.items()]
        return [*conditions, *((f"model {name}", one) for name, one in self.solids.items())]

    def snapshot(self) -> dict[str, Array]:
        """Return copies of all that residual and derivative depend on beside the case, for `restore`."""
        return {name: np.array(part) for name, part in self._arrays().items()}

    def _arrays(self) -> dict[str, Array]:
        arrays = {name: np.asarray(field.vec.FV().NumPy()) for name, field in self._stored.items()}
        arrays["parameters"] = np.array([parameter.Get() for parameter in self._parameters])
        for name, part in self._with_memory():
            arrays |= {f"{name}.{key}": array for key, array in part.state_arrays().items()}
        return arrays

    def changed_state(self) -> dict[str, Any]:
        """Return of the snapshot what is not as it was at the last call, for `take`: of a vector of which little has
        changed, numbers and values of that."""
        before, changed = self._last_sent, dict[str, Any]()
        for name, part in self._arrays().items():
            if name in before and name in self._stored:
                other = np.flatnonzero(part != before[name])
                before[name][other] = part[other]
                if len(other):
                    changed[name] = (other, part[other]) if len(other) < FEW * len(part) else before[name]
            elif not np.array_equal(part, before.get(name, ())):
                before[name] = changed[name] = np.array(part)
        return changed

    def all_have_state(self) -> None:
        """Take note that all ranks have the vector of unknowns as it is now."""
        if "state" in self._last_sent:
            self._last_sent["state"][:] = self.values

    def take(self, changed: Mapping[str, Any]) -> None:
        """Take over what rank 0 has as its `changed_state`."""
        for name, part in changed.items():
            if name not in self._stored:
                self._received[name] = part
                continue
            numbers, values = part if isinstance(part, tuple) else (slice(None), part)
            self._stored[name].vec.FV().NumPy()[numbers] = values
        if "parameters" in changed:
            self._set_parameters(self._received["parameters"])
        if not set(changed) <= {*self._stored, "parameters"}:
            self._restore_memory(self._received)

    def restore(self, snapshot: Mapping[str, Array]) -> None:
        """Take the state, rates and conditions of a snapshot of an equal system."""
        for name, field in self._stored.items():
            field.vec.FV().NumPy()[:] = snapshot[name]
        self._set_parameters(snapshot["parameters"])
        self._restore_memory(snapshot)

    def _set_parameters(self, values: Array) -> None:
        for parameter, value in zip(self._parameters, values, strict=True):
            parameter.Set(float(value))
        self.set_step(self.step.Get())

    def _restore_memory(self, snapshot: Mapping[str, Array]) -> None:
        for name, part in self._with_memory():
            part.restore_state(part_of(snapshot, name))

    def rates(self) -> Array:
        """Rates of all unknowns at the present state."""
        return np.asarray(self.new_weight.Get() * self.values + self.velocity_history.vec.FV().NumPy())

    def residual(self) -> Any:
        """Return the residual at the present state, each equation in its unknown's place; overwritten later.

        Prescribed values are brought up to date.
        """
        with self.watch("residuals"):
            self.prescribe()
            with self.ranks.order("residual", self.changed_state):
                self.ranks.add(np.asarray(self.part_of_residual().FV().NumPy()))
        return self._residual

    def part_of_residual(self) -> Any:
        """Return this rank's part of the residual, each equation in its unknown's place; overwritten later."""
        with self.watch("residuals"):
            values = self.apply()
            values[:] = self.unknowns.arranged(values)
        return self._residual

    def distribution(self, chosen: Mask) -> Distribution:
        """Return which of the chosen unknowns are whose, for calls of all ranks."""
        if self.ranks.size == 1:
            numbers = np.arange(self.unknowns.size)
        else:
            space, mine = self.unknowns.space, self.mine(ng.VOL)
            found = [space.GetDofNrs(e) for e in self.domain.mesh.Elements(ng.VOL) if mine is None or mine[e.nr]]
            numbers = np.unique([number for of_one in found for number in of_one if number >= 0])
        touched = np.zeros(self.unknowns.size, dtype=bool)
        touched[numbers] = True
        return Distribution(self.ranks, int(np.sum(chosen)), np.flatnonzero(touched[chosen]))

    def is_at_rest(self) -> bool:
        """Whether nothing moves and nothing acts, but for rounding of the stresses in the given shape."""
        forces = np.asarray(self.residual().FV().NumPy())[self.unknowns.solvable]
        rounding = ROUNDING * self._stiffness() * self.domain.geometry.size**2 if self.solids else 0.0
        return not np.any(self.values) and float(np.max(np.abs(forces), initial=0.0)) <= rounding

    def apply(self) -> Array:
        """Evaluate this rank's part of the residual of the weak form at the present state, and return it."""
        self.ranks.together(lambda: self.form.Apply(self.state.vec, self._residual))
        return np.asarray(self._residual.FV().NumPy())

    def sentence(self) -> str:
        """Return what acts now, for reports and failures."""
        return ", ".join(said for condition in self.conditions.values() if (said := condition.sentence()))

    def gaps(self) -> Array:
        """Return the present distances of whatever must not meet, over those at the start (`Condition.gaps`)."""
        return np.concatenate([np.zeros(0), *(condition.gaps() for condition in self.conditions.values())])

    def block_scales(self) -> dict[str, float]:
        """Physical scale of each block, against which changes are judged.

        d, e: size of the geometry; w: mean velocity of the largest flow that a condition drives, while solids move at
        least of 1 % of the blood's volume per second; p: the largest pressure that a condition puts on the blood, 1 Pa
        at least.
        """
        size, scales = self.domain.geometry.size, dict(self.unknowns.scales)
        if "s" in self.unknowns.blocks:
            scales["s"] = 1.0
        if not self.domain.lumens:
            return {"d": size, **scales}
        conditions = self.conditions.values()
        flow = max(SLOWEST * self._volume, *(c.flow_scale() for c in conditions))
        pressure = max(1.0, *(c.pressure_scale() for c in conditions))
        return {"d": size, "e": size, "w": flow / max(self._areas.values()), "p": pressure} | scales
