"""The coupled system: residual and linearisation of tissue, blood and mesh motion in one vector of unknowns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import ngsolve as ng
import numpy as np
from ngsolve import GridFunction, Inv, Parameter
from numpy.typing import NDArray

from ngfsi.case import Case
from ngfsi.materials import Newtonian
from ngfsi.materials.solid.small_strain import SmallStrain
from ngfsi.mesh.domain import Domain, elements_at
from ngfsi.outlines.displacement import OutlineDisplacement
from ngfsi.parallel.ranks import SERIAL, Ranks
from ngfsi.parallel.stopwatch import Stopwatch
from ngfsi.physics import terms
from ngfsi.physics.kinematics import Kinematics, in_space
from ngfsi.system.boundary import boundary_values
from ngfsi.system.forms import Integral, WithInertia, WithoutRows, reduced_rules, residual_form, rules, tangent_form
from ngfsi.system.schemes import STEADY, Weights
from ngfsi.system.unknowns import Unknowns

if TYPE_CHECKING:
    from ngfsi.linear.multigrid import Levels

Vector = NDArray[np.float64]

EXTRA_ORDER = 1
"""Integration order of the blood's terms beyond twice that of the elements, for the lumen's balance of mass,
cof(F) : grad u. It is free on hexahedra of order 2, and the balance closes to 1e-7 of the flow; 2 closes it to
rounding, but doubles the cost of the Jacobian and changes the mean wall shear by 6e-4."""


@dataclass(frozen=True)
class Fields:
    """The blood's and the mesh's fields as coefficient functions of the unknowns (trial functions or a state).

    Attributes:
        motion, grad_motion: displacement m of the mesh and its reference gradient.
        relative: velocity w of the blood relative to the mesh.
        velocity, grad_velocity: u = w + rate of m, and its reference gradient.
        acceleration: rate of u at a fixed reference point.
        pressure: p.
    """

    motion: Any
    grad_motion: Any
    relative: Any
    velocity: Any
    grad_velocity: Any
    acceleration: Any
    pressure: Any


def second_rate(new: Any, state: Any, velocity_history: Any, acceleration_history: Any) -> Any:
    """Return the rate of the rate of a state, as arrays or coefficient functions."""
    return new * (new * state + velocity_history) + acceleration_history


class System:
    """Weak form of a case on a domain, with its state, its rates and its loads.

    Rates are linear in the state: rate(y) = new * y + history. `velocity_history` and `acceleration_history` hold
    the old states' part for each unknown, in the same vector layout as the state itself.
    """

    def __init__(
        self, case: Case, domain: Domain, watch: Stopwatch | None = None, ranks: Ranks = SERIAL,
        elements: ng.BitArray | None = None,
    ) -> None:  # fmt: skip
        """Build the forms.

        Args:
            watch: takes the seconds of residuals, assembly, factorisation and solves.
            ranks: ranks that work on the same case together.
            elements: those of which this rank has the integrals; default: all.
        """
        self.case, self.domain, self.ranks = case, domain, ranks
        self.watch = watch or Stopwatch()
        inflow = case.loads.inlet_pressure is None
        given = case.conditions
        self.unknowns = Unknowns.build(
            domain, case.discretisation.order, given.ends, inflow=inflow, plane_stress=given.plane_stress,
            moved=("skin",) if given.skin_displacement else (),
        )  # fmt: skip
        space = self.unknowns.space
        self.state = GridFunction(space)
        self.velocity_history = GridFunction(space)
        self.acceleration_history = GridFunction(space)
        self.new_weight = Parameter(0.0)
        self.skin_pressure = Parameter(0.0)
        self.cuff_pressures = [Parameter(0.0) for _ in case.loads.cuffs]
        self.outlet_pressure, self.inlet_pressure = Parameter(0.0), Parameter(0.0)
        self.openings = {"outlet": self.outlet_pressure} | ({} if inflow else {"inlet": self.inlet_pressure})
        self.blood_density = Parameter(self.blood.density if domain.geometry.fluid else 0.0)
        self.flow_rate = 0.0
        laws = {name: case.materials.law_of(name) for name in domain.geometry.solids}
        self._small = given.strain == "small"
        self.solids: dict[str, Any] = {name: SmallStrain(law) for name, law in laws.items()} if self._small else laws
        self._skin = SkinMotion(self, given.skin_displacement) if given.skin_displacement else None
        self.relaxation: GridFunction | None = None
        if case.conditions.initial_state == "prestress":
            self.relaxation = GridFunction(space.components[0])
        self.form, self.tangent = self._forms(space, elements)
        self._residual = self.state.vec.CreateVector()
        self._last_sent: dict[str, Vector] = {}
        self._inlet = Inlet(self) if domain.geometry.fluid else None

    @property
    def blood(self) -> Newtonian:
        """The fluid, of a system that has one."""
        assert self.case.materials.fluid is not None
        return self.case.materials.fluid

    @cached_property
    def levels(self) -> Levels:
        """The levels of p-multigrid, as solver and for nothing else."""
        from ngfsi.linear.multigrid import levels_of  # with SciPy's GMRES, which direct solvers do without

        return levels_of(self.domain, self.unknowns)

    # ---------------------------------------------------------------- weak form

    def _forms(self, space: Any, elements: ng.BitArray | None) -> tuple[Any, Any]:
        """Return residual and tangent.

        With one-way coupling the blood's terms are missing in the equations of the solids, where they are its traction.
        """
        parts = self.parts(elements)
        residual: Any = residual_form(space, parts)
        trial, test = space.TnT()
        velocity, rest = (field.components[0] for field in (self.velocity_history, self.acceleration_history))
        acceleration = second_rate(self.new_weight, trial[0], velocity, rest)
        linear = [*parts, *self.inertia_parts(acceleration, test[0], elements)]
        # interior unknowns appear from order 3 on
        tangent: Any = tangent_form(space, linear, condense=self.unknowns.order >= 3 and not self._one_way)
        if self._one_way:
            blood, rows = self.fluid_parts(elements), self.unknowns.blocks["d"]
            residual = WithoutRows(residual, residual_form(space, blood), rows)
            tangent = WithoutRows(tangent, tangent_form(space, blood), rows)
        return self._with_inertia(residual, elements), tangent

    def _with_inertia(self, residual: Any, elements: ng.BitArray | None) -> WithInertia:
        motion = self.unknowns.space.components[0]
        trial, test = motion.components[0].TnT()
        mass = tangent_form(motion.components[0], self.inertia_parts(trial, test, elements))
        velocity, rest = (field.vec.FV().NumPy() for field in (self.velocity_history, self.acceleration_history))

        def acceleration(values: Vector) -> Vector:
            return np.asarray(second_rate(self.new_weight.Get(), values, velocity, rest))

        return WithInertia(residual, mass, motion, acceleration)

    @property
    def _one_way(self) -> bool:
        return self.case.conditions.coupling == "one_way" and self.domain.has_boundary("interface")

    def fields(self, parts: Any) -> Fields:
        """Return the blood's and the mesh's fields for `parts` = (m, w, p)."""
        m, w, p = parts
        hm, hw, _ = self.velocity_history.components
        am = self.acceleration_history.components[0]
        new = self.new_weight
        u = w + new * m + hm
        return Fields(
            motion=m,
            grad_motion=ng.Grad(m),
            relative=w,
            velocity=u,
            grad_velocity=ng.Grad(w) + new * ng.Grad(m) + ng.Grad(hm),
            acceleration=new * u + hw + am,
            pressure=p,
        )

    def stress_free_gradient(self) -> Any | None:
        """G = dX/dX0 where the reference shape is prestressed: inverse of I + grad(X0 - X)."""
        return None if self.relaxation is None else Inv(Kinematics(ng.Grad(self.relaxation)).F)

    def fluid_form(self, at: str | None = None) -> ng.BilinearForm:
        """Return the residual of the fluid alone: what it lacks at a boundary is the force on that boundary.

        Args:
            at: a boundary: elements that do not touch it are left out.
        """
        near = None if at is None else elements_at(self.domain, self.domain.fluid, at)
        return residual_form(self.unknowns.space, self.fluid_parts(near))

    def parts(self, elements: ng.BitArray | None = None) -> list[Integral]:
        """Return the integrands of the weak form but the solids' inertia, on some elements or all; of several ranks
        the first has those on boundaries."""
        return self.solid_parts(elements) + (self.fluid_parts(elements) if self.domain.geometry.fluid else [])

    def _rules(self, order: int) -> dict[Any, ng.IntegrationRule]:
        return rules(order + self.case.discretisation.extra_integration_order)

    def hydrostatic_pressure(self, region: str) -> Any:
        """Return p = -tr(sigma)/3 (Pa) of a solid in the present state."""
        F = Kinematics(ng.Grad(self.state.components[0])).F
        stretch = 1 + self.state.components[1] if region in self.case.conditions.plane_stress else 1
        law = self.solids[region]
        if not self._small:
            return terms.hydrostatic_pressure(law, F, stretch)
        return -law.variation(in_space(F, stretch), ng.Id(3)) / 3

    def work_parts(
        self, name: str, F: Any, grad_v: Any, relaxation: Any | None, across: tuple[Any, Any] = (1, 0),
        elements: ng.BitArray | None = None,
    ) -> list[Integral]:  # fmt: skip
        """Return the virtual work of a solid's stresses, at all integration points first."""
        order, law = self.unknowns.order, self.solids[name]
        dx = partial(self.domain.dx, name, definedonelements=elements)
        measure = dx(intrules=self._rules(2 * order))
        if self.case.discretisation.bulk_integration == "full":
            return [Integral([terms.internal_work(law, F, grad_v, relaxation, across)], measure)]
        rest, bulk = terms.internal_works(law, F, grad_v, relaxation, across)
        return [Integral([rest], measure), Integral([bulk], dx(intrules=reduced_rules(order)))]

    def solid_parts(self, elements: ng.BitArray | None = None) -> list[Integral]:
        """Return the integrands of the solids and of the pressures on skin and lumens."""
        trial, test = self.unknowns.space.TnT()
        m, v = trial[0], test[0]
        F, relaxation = Kinematics(ng.Grad(m)).F, self.stress_free_gradient()
        parts = []
        for name in self.solids:
            # the stretch across the plane and its variation
            across = (1 + trial[1], test[1]) if name in self.case.conditions.plane_stress else (1, 0)
            parts += self.work_parts(name, F, ng.Grad(v), relaxation, across, elements)
        if not self.ranks.leads:
            return parts
        if self.domain.has_boundary("skin"):
            parts.append(self._pressure_on("skin", self._on_skin(), m, v))
        if self._one_way:
            parts.append(self._blood_on_wall(self.outlet_pressure, m, v))
        lumens = getattr(self.domain.geometry, "lumen_names", ())
        return parts + [self._pressure_on(name, self.outlet_pressure, m, v) for name in lumens]

    def inertia_parts(self, acceleration: Any, v: Any, elements: ng.BitArray | None = None) -> list[Integral]:
        """Return the integrands of the solids' inertia, for one component or all of an acceleration."""
        measure = partial(self.domain.dx, definedonelements=elements, intrules=self._rules(2 * self.unknowns.order))
        return [Integral([terms.inertia(law.density, acceleration, v)], measure(n)) for n, law in self.solids.items()]

    def static_parts(self, m: Any, v: Any) -> list[Integral]:
        """Return the integrands of the solids at rest under the present pressures, the blood's held as it is.

        Args:
            m, v: motion and test function of the space of the motion alone.
        """
        F, relaxation = Kinematics(ng.Grad(m)).F, self.stress_free_gradient()
        parts = [part for name in self.solids for part in self.work_parts(name, F, ng.Grad(v), relaxation)]
        if self.domain.has_boundary("skin"):
            parts.append(self._pressure_on("skin", self._on_skin(), m, v))
        if self.domain.geometry.fluid and self.domain.has_boundary("interface"):
            blood = self.outlet_pressure if self._one_way else self.state.components[2]
            parts.append(self._blood_on_wall(blood, m, v))
        return parts

    def _blood_on_wall(self, pressure: Any, m: Any, v: Any) -> Integral:
        """Return the work of a pressure of the blood on the deformed interface."""
        k, out_of_blood = Kinematics(ng.Grad(m).Trace()), self.domain.outward_normal()
        return Integral([-terms.follower_pressure(pressure, k, out_of_blood, v.Trace())], self.domain.ds("interface"))

    def _pressure_on(self, name: str, pressure: Any, m: Any, v: Any) -> Integral:
        """Return the work of a pressure on a boundary, on its deformed shape unless strains are small."""
        normal, grad_m = ng.specialcf.normal(self.domain.mesh.dim), ng.Grad(m)
        if self.domain.mesh.dim == 3:
            k = Kinematics(grad_m.Trace())
            return Integral([terms.follower_pressure(pressure, k, normal, v.Trace())], self.domain.ds(name))
        # around holes of the plane the normal is outward only as the elements' own
        k = Kinematics(0 * grad_m if self._small else grad_m)
        return Integral([terms.follower_pressure(pressure, k, normal, v)], self.domain.ds(name, skeleton=True))

    def _on_skin(self) -> Any:
        """Return the pressure on the skin as a function of place."""
        parts = [
            pressure * terms.part_of_skin(cuff.start, cuff.end, cuff.edge, cuff.direction, cuff.half_width)
            for pressure, cuff in zip(self.cuff_pressures, self.case.loads.cuffs, strict=True)
        ]
        return sum(parts, self.skin_pressure)

    def fluid_parts(self, elements: ng.BitArray | None = None) -> list[Integral]:
        """Return the integrands of the blood and of the mesh motion."""
        trial, test = self.unknowns.space.TnT()
        blood, f = self.blood, self.fields(trial)
        k = Kinematics(f.grad_motion)
        # which unknown's equation that makes: see Unknowns.equations
        v, v_mesh = test[0], test[1]
        inside = [
            terms.convective_inertia(self.blood_density, k, f.acceleration, f.grad_velocity, f.relative, v),
            terms.fluid_stress_work(blood, k, f.grad_velocity, f.pressure, ng.Grad(v)),
            terms.incompressibility(k, f.grad_velocity, test[2]),
        ]
        stiffness = self.case.discretisation.extension_stiffness
        if self.case.discretisation.mesh_motion == "harmonic":
            inside.append(terms.harmonic_extension(stiffness, f.grad_motion, ng.Grad(v_mesh)))
        else:
            stiffness *= (self.domain.geometry.size / ng.specialcf.mesh_size) ** 2
            inside.append(terms.elastic_extension(stiffness, k, ng.Grad(v_mesh)))
        points = self._rules(2 * self.unknowns.order + EXTRA_ORDER)
        measure = self.domain.dx(self.domain.fluid, intrules=points, definedonelements=elements)
        return [Integral(inside, measure), *(self._through(n, f, k, v, elements) for n in self.openings)]

    def _through(self, name: str, f: Fields, k: Kinematics, v: Any, elements: ng.BitArray | None) -> Integral:
        """Return the traction on an opening as an integral over the boundary of the elements there.

        NGSolve's own over a boundary with the whole gradient (`skeleton`) takes all elements, and room for them.
        """
        face = GridFunction(ng.FacetFESpace(self.domain.mesh, order=0))
        face.Set(1, definedon=self.domain.boundaries(name))
        near = elements_at(self.domain, self.domain.fluid, name)
        side = self.domain.dx(
            self.domain.fluid, element_boundary=True, definedonelements=near if elements is None else near & elements
        )
        return Integral([face * self.opening(name, f, k, v)], side)

    def opening(self, name: str, f: Fields, k: Kinematics, v: Any) -> Any:
        """Return the integrand of the traction on an opening with a prescribed pressure; needs the full gradient."""
        normal = ng.specialcf.normal(self.domain.mesh.dim)
        traction = terms.opening(self.blood, self.openings[name], k, f.grad_velocity, normal, v)
        if name == "inlet":  # where blood is meant to enter with its energy
            return traction
        return traction + terms.backflow(self.blood_density, k, f.velocity, f.relative, normal, v)

    def apply_inflow(self) -> None:
        """Scale the inlet profile so that the flux through the deformed inlet is `flow_rate` (m3/s)."""
        if self._inlet is not None and "inlet" not in self.openings:
            self.values[self.unknowns.inlet] = self._inlet.profile * (self.flow_rate / self._inlet.flux())

    def prescribe(self, share: float) -> None:
        """Move boundaries of prescribed displacement by a share of it."""
        if self._skin is not None:
            self.values[self._skin.numbers] = share * self._skin.values

    # ---------------------------------------------------------------- state, loads, rates

    @property
    def values(self) -> Vector:
        """The state's vector of unknowns, as a view."""
        return np.asarray(self.state.vec.FV().NumPy())

    def set_loads(self, t: float) -> None:
        """Take the loads of time t (s)."""
        loads = self.case.loads
        self.skin_pressure.Set(loads.skin_pressure(t))
        for parameter, cuff in zip(self.cuff_pressures, loads.cuffs, strict=True):
            parameter.Set(cuff.pressure(t))
        self.outlet_pressure.Set(loads.outlet_pressure(t))
        if loads.inlet_pressure is None:
            self.flow_rate = loads.inlet_flow(t)
        else:
            self.inlet_pressure.Set(loads.inlet_pressure(t))
        self.prescribe(1.0)

    def set_rates(self, weights: Weights, states: tuple[Vector, Vector], rates: tuple[Vector, Vector]) -> None:
        """Take the weights of a step and the histories of (last, second last) states and rates."""
        self.new_weight.Set(weights.new)
        self.velocity_history.vec.FV().NumPy()[:] = weights.old * states[0] + weights.older * states[1]
        self.acceleration_history.vec.FV().NumPy()[:] = weights.old * rates[0] + weights.older * rates[1]

    def set_steady(self) -> None:
        """Let all rates vanish."""
        zero = np.zeros(self.unknowns.size)
        self.set_rates(STEADY, (zero, zero), (zero, zero))

    def snapshot(self) -> dict[str, Vector]:
        """Return copies of all that residual and derivative depend on beside the case, for `restore`."""
        fields = {name: np.array(field.vec.FV().NumPy()) for name, field in self._fields_of_state().items()}
        return fields | {"loads": np.array([p.Get() for p in self._parameters()] + [self.flow_rate])}

    def changed_state(self) -> dict[str, Vector]:
        """Return of the snapshot what is not as it was at the last call."""
        before, self._last_sent = self._last_sent, self.snapshot()
        return {name: part for name, part in self._last_sent.items() if not np.array_equal(part, before.get(name, ()))}

    def restore(self, snapshot: Mapping[str, Vector]) -> None:
        """Take the state, rates and loads of a snapshot of an equal system."""
        for name, field in self._fields_of_state().items():
            field.vec.FV().NumPy()[:] = snapshot[name]
        *values, self.flow_rate = map(float, snapshot["loads"])
        for parameter, value in zip(self._parameters(), values, strict=True):
            parameter.Set(value)

    def _fields_of_state(self) -> dict[str, GridFunction]:
        fields = {"state": self.state, "velocity_history": self.velocity_history}
        fields["acceleration_history"] = self.acceleration_history
        return fields if self.relaxation is None else {**fields, "relaxation": self.relaxation}

    def _parameters(self) -> tuple[Parameter, ...]:
        pressures = (self.skin_pressure, self.outlet_pressure, self.inlet_pressure)
        return (self.new_weight, self.blood_density, *pressures, *self.cuff_pressures)

    def rates(self) -> Vector:
        """Rates of all unknowns at the present state."""
        return np.asarray(self.new_weight.Get() * self.values + self.velocity_history.vec.FV().NumPy())

    def residual(self) -> Any:
        """Return the residual at the present state, each equation in its unknown's place; overwritten later.

        The inflow is brought up to date.
        """
        with self.watch("residuals"):
            self.apply_inflow()
            with self.ranks.order("residual", self.changed_state):
                values = self.apply()
        values[:] = values[self.unknowns.equations]
        return self._residual

    def apply(self) -> Vector:
        """Evaluate the residual of the weak form at the present state, each rank its share, and return it."""
        self.ranks.together(lambda: self.form.Apply(self.state.vec, self._residual))
        values = np.asarray(self._residual.FV().NumPy())
        self.ranks.add(values)
        return values

    def block_scales(self) -> dict[str, float]:
        """Physical scale of each block, against which changes are judged.

        d, e: size of the geometry; w: mean velocity of the larger of inflow and 1 % of the fluid's volume per second
        (for runs without inflow); p: the largest of the pressures at the openings and 1 Pa.
        """
        size = self.domain.geometry.size
        if self._inlet is None:
            return {"d": size, "s": 1.0} if "s" in self.unknowns.blocks else {"d": size}
        speed = max(abs(self.flow_rate), 0.01 * self._inlet.volume) / self._inlet.area
        pressure = max(1.0, *(abs(p.Get()) for p in self.openings.values()))
        return {"d": size, "e": size, "w": speed, "p": pressure}


class SkinMotion:
    """The prescribed displacement of a plane section's skin: numbers of its unknowns and their values (m)."""

    def __init__(self, system: System, displacement: OutlineDisplacement) -> None:
        domain, space = system.domain, system.unknowns.space.components[0]
        given = boundary_values(domain, "skin", system.unknowns.order, displacement)
        self.numbers = np.flatnonzero(list(space.GetDofs(domain.boundaries("skin"))))
        self.values = given[self.numbers]


class Inlet:
    """Where the fluid enters.

    Attributes:
        profile: unknowns of the relative velocity on the inlet for a mean velocity of 1 m/s in the reference shape.
        area: of the inlet, and `volume`: of the fluid, in the reference shape (m2, m3).
    """

    def __init__(self, system: System) -> None:
        domain, unknowns = system.domain, system.unknowns
        self._mesh = domain.mesh
        self._field = GridFunction(unknowns.space)
        entering = self._field.components[1]
        entering.Set(domain.geometry.inflow(), definedon=domain.boundaries("inlet"), bonus_intorder=4)
        self.profile: Vector = np.array(self._field.vec.FV().NumPy()[unknowns.inlet])
        motion, normal = Kinematics(ng.Grad(system.state.components[0])), ng.specialcf.normal(self._mesh.dim)
        measure = domain.ds("inlet", bonus_intorder=2 * unknowns.order)
        self._flux = terms.relative_flux(motion, entering, normal) * measure
        self.area, self.volume = domain.area("inlet"), domain.volume(domain.fluid)

    def flux(self) -> float:
        """Return the flux (m3/s) of the profile through the deformed inlet."""
        return abs(float(ng.Integrate(self._flux, self._mesh)))
