"""Measured quantities as functions of integrals over the state, which NGSolve differentiates.

A quantity is one entry of `FUNCTIONALS`: integrands, and what is made of the integrals. It is named like its column of
series.csv without the unit, and has its value (tests/gradient hold that).
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import InnerProduct

from ngfsi.arrays import Array
from ngfsi.conditions.openings import through
from ngfsi.errors import CaseError, unknown
from ngfsi.gradient.window import Window
from ngfsi.measure.hole import Hole
from ngfsi.measure.plane import PlaneSectionProbe
from ngfsi.measure.sections import STATIONS, Sections
from ngfsi.mesh.centreline import find_centrelines
from ngfsi.mesh.geometry import Vessel
from ngfsi.physics import terms
from ngfsi.physics.fields import MOTION, PRESSURE, VELOCITY, Fields, Named
from ngfsi.physics.integrals import Integral, rules
from ngfsi.physics.kinematics import Kinematics
from ngfsi.system.system import System
from ngfsi.units import in_unit, to_si

AT_HEIGHT = re.compile(r"area_at_(\d+(?:\.\d+)?)mm")
"""Area of the lumen at a distance along the centreline."""
POINTS = 6
"""Orders of integration more for each distance of stations that an element is long."""
SHARPNESS = 32
"""Power of the smooth minimum: it is at most 15 % above the smallest face's if that is a hundredth of the wall."""
SMALL = 1e-30
"""Step of a derivative by a complex argument."""


@dataclass(frozen=True)
class Place:
    """Where a quantity is measured: trial functions of the state and of the velocity's history stand for the fields."""

    system: System
    vessel: Any
    motion: Any
    fields: Fields | None

    @property
    def order(self) -> int:
        """Order of integrals over the deformed blood, or its surface: of a polynomial of the motion."""
        return 3 * max(self.system.unknowns.order, self.system.domain.geometry.curving_order) - 1

    def inside(self, integrand: Any) -> Integral:
        """Return an integral over the blood."""
        return Integral([integrand], self.system.domain.dx(str(self.vessel.lumen), intrules=rules(self.order)))

    def around(self, boundary: str, integrand: Any, elements: ng.BitArray | None = None, more: int = 0) -> Integral:
        """Return an integral over a boundary of the blood, of some elements or all, the normal
        `ng.specialcf.normal(3)` pointing out of it; `more`: order of integration beyond the usual."""
        bonus = self.system.unknowns.order + more
        return through(self.system.domain, str(self.vessel.lumen), boundary, integrand, elements, bonus)


@dataclass(frozen=True)
class Functional:
    """A quantity.

    Attributes:
        unit: as the suffix of its column.
        integrals: returns them at a place, by name: of the fields of blood and mesh, and of the law of the blood.
        value: returns the quantity from a system and the values of the integrals, which may be complex.
    """

    unit: str
    integrals: Callable[[Place], Mapping[str, Integral]]
    value: Callable[[System, Any, Mapping[str, Any]], Any]


def _volume(place: Place) -> dict[str, Integral]:
    assert place.fields is not None
    return {"volume": place.inside(Kinematics(place.fields.grad_motion).J)}


def _shear_and_size(place: Place) -> tuple[Any, Any]:
    """Return the size of the wall shear stress, from the trace of the velocity's gradient, and the deformed area over
    that of the reference shape."""
    f = place.fields
    assert f is not None
    k = Kinematics(f.grad_motion)
    area = k.cof * ng.specialcf.normal(3)
    size = ng.Norm(area)
    shear = terms.tangential(terms.viscous_stress(place.system.blood, k, f.grad_velocity) * (area / size), area / size)
    return ng.Norm(shear), size


def _shear(place: Place, weight: Any = 1.0, *on: Any) -> dict[str, Integral]:
    """Return the size of the wall shear stress, and the deformed area, both times a weight; `on`: as of
    `Place.around`."""
    shear, size = _shear_and_size(place)
    parts = {"shear": weight * shear * size, "size": weight * size}
    return {name: place.around(place.vessel.interface, part, *on) for name, part in parts.items()}


def _shear_at(station: int) -> Callable[[Place], dict[str, Integral]]:
    """Return the wall shear stress around a station: its weight falls off evenly to the stations beside it."""

    def integrals(place: Place) -> dict[str, Integral]:
        domain, vessel = place.system.domain, place.vessel
        line, wall = find_centrelines(domain, vessel)[0], domain.vertices_on(vessel.interface)
        along = ng.GridFunction(ng.H1(domain.mesh, order=1))
        heights = along.vec.FV().NumPy()
        heights[wall] = line.coordinate(domain.vertices[wall])
        middle, apart = station * line.length / (STATIONS - 1), line.length / (STATIONS - 1)
        away, longest = (along - middle) / apart, 0.0
        weight = 1 - ng.IfPos(away, away, -away)  # a norm has no derivative at the station itself, not even of 0
        on_wall, near = set(wall.tolist()), ng.BitArray(domain.mesh.ne)
        near.Clear()
        for element in domain.materials(str(vessel.lumen)).Elements():
            ends = heights[[vertex.nr for vertex in element.vertices if vertex.nr in on_wall]]
            if len(ends) and ends.min() < middle + apart and ends.max() > middle - apart:
                near.Set(element.nr)
                longest = max(longest, float(np.ptp(ends)))
        # elements may be longer than the part of the wall that counts
        return _shear(place, ng.IfPos(weight, weight, 0.0), near, POINTS * round(longest / apart))

    return integrals


def _at_opening(opening: str) -> Callable[[Place], dict[str, Integral]]:
    def integrals(place: Place) -> dict[str, Integral]:
        f, normal = place.fields, ng.specialcf.normal(3)
        assert f is not None
        k = Kinematics(f.grad_motion)
        size, flux = ng.Norm(k.cof * normal), terms.relative_flux(k, f.relative, normal)
        parts = {"pressure": f.pressure * size, "size": size, "flux": flux}
        return {name: place.around(opening, part) for name, part in parts.items()}

    return integrals


def _pressure(system: System, vessel: Vessel, of: Mapping[str, Any]) -> Any:
    return of["pressure"] / of["size"] + system.reference(vessel.name).Get()


def _flow(sign: float, _system: System, _vessel: Vessel, of: Mapping[str, Any]) -> Any:
    return sign * of["flux"]


def _hole(place: Place) -> dict[str, Integral]:
    """Return the volume of a hole between ends that stay in their planes, as `measure.hole` does."""
    system, domain = place.system, place.system.domain
    n = ng.CF(tuple(domain.mean_normal(domain.ends[0])))
    across = ng.CF((ng.x, ng.y, ng.z)) + place.motion.Trace()
    across = across - InnerProduct(across, n) * n
    area = Kinematics(ng.Grad(place.motion).Trace()).cof * domain.outer_normal()
    measure = domain.ds(place.vessel.interface, bonus_intorder=2 * system.unknowns.order)
    return {"volume": Integral([-InnerProduct(across, area) / 2], measure)}


def _of_volume(_system: System, _vessel: Vessel | None, of: Mapping[str, Any]) -> Any:
    return of["volume"]


def _mean_shear(_system: System, _vessel: Vessel | None, of: Mapping[str, Any]) -> Any:
    return of["shear"] / of["size"]


FUNCTIONALS: dict[str, Functional] = {
    "lumen_volume": Functional("m3", _volume, _of_volume),
    "sawss": Functional("Pa", _shear, _mean_shear),
}


def _enclosed(boundary: str) -> Callable[[Place], dict[str, Integral]]:
    """Return the area inside of a closed boundary of a plane section, as `measure.plane` does."""

    def integrals(place: Place) -> dict[str, Integral]:
        domain, motion = place.system.domain, place.motion
        face = ng.GridFunction(ng.FacetFESpace(domain.mesh, order=0))
        face.Set(1, definedon=domain.boundaries(boundary))
        flux = (ng.CF((ng.x, ng.y)) + motion) * (Kinematics(ng.Grad(motion)).cof * ng.specialcf.normal(2))
        bonus = 2 * place.system.unknowns.order
        measure = domain.dx(*domain.regions, element_boundary=True, bonus_intorder=bonus)
        return {"area": Integral([face * flux / 2], measure)}

    return integrals


def _of_region(region: str) -> Callable[[Place], dict[str, Integral]]:
    def integrals(place: Place) -> dict[str, Integral]:
        J = Kinematics(ng.Grad(place.motion)).J
        return {"area": Integral([J], place.system.domain.dx(region, intrules=rules(place.order)))}

    return integrals


def _area(_system: System, _vessel: Vessel | None, of: Mapping[str, Any]) -> Any:
    return of["area"] if np.real(of["area"]) > 0 else -of["area"]


def functionals_of(system: System) -> dict[str, tuple[Functional, Vessel | None]]:
    """Return what integrals tell of a system, by the name of its column without the unit."""
    found: dict[str, tuple[Functional, Vessel | None]] = {}
    if system.domain.mesh.dim == 2:
        if not system.domain.lumens:
            plane = PlaneSectionProbe(system)
            found |= {f"{name}_area": (Functional("m2", _enclosed(name), _area), None) for name in plane.outlines}
            found |= {f"{name}_area": (Functional("m2", _of_region(name), _area), None)
                      for name in system.domain.regions}  # fmt: skip
        return found
    holes = Hole.all_of(system)
    for vessel in system.domain.vessels:
        prefix = f"{vessel.name}_" if vessel.name else ""
        if vessel.lumen is None:
            if vessel.name in holes:
                found[f"{prefix}lumen_volume"] = Functional("m3", _hole, _of_volume), vessel
            continue
        found |= {f"{prefix}{name}": (one, vessel) for name, one in FUNCTIONALS.items()}
        for opening in vessel.openings:
            found[f"pressure_{opening}"] = Functional("Pa", _at_opening(opening), _pressure), vessel
        for name, openings, sign in (("flow_in", vessel.inlets, -1.0), ("flow_out", vessel.outlets, 1.0)):
            if len(openings) == 1:
                flow = Functional("m3_s", _at_opening(openings[0]), partial(_flow, sign))
                found[f"{prefix}{name}"] = flow, vessel
    return found


class Measured(ABC):
    """A quantity of a system's present state, with its derivatives.

    Attributes:
        unit: as the suffix of its column.
    """

    unit: str

    @abstractmethod
    def value(self) -> float:
        """Return the quantity in the present state (SI)."""

    def record(self) -> Any:
        """Return what is kept of the present state for `made`: one number, or an array of parts."""
        return self.value()

    def made(self, window: Window, times: Array, records: Array) -> tuple[float, Array]:
        """Return what is made of records of all states at times (s), and its derivatives by the values at the states,
        of which those of parts are sums with weights found here."""
        return window.weights(times, records)

    def weighed(self, record: Any) -> float:
        """Return the value at a state of which a record is kept, after `made`."""
        return float(record)

    @abstractmethod
    def gradient(self) -> tuple[Array, Array]:
        """Return its derivatives by all unknowns, and by the history of the velocity."""

    @abstractmethod
    def under(self, system: System) -> Any:
        """Return the record of the state of the last `record` or `gradient`, with the loads of another system."""


def measured(system: System, name: str) -> Measured:
    """Return a quantity of a system.

    Raises:
        CaseError: the model has no such quantity, or it cannot be differentiated.
    """
    known = functionals_of(system)
    if name in known:
        return OfIntegrals(system, *known[name])
    areas: dict[str, tuple[Vessel, int | float]] = {}
    shears: dict[str, tuple[Vessel, int]] = {}
    if system.domain.mesh.dim == 3:
        for vessel in system.domain.vessels:
            if vessel.lumen and not vessel.branched:
                prefix = f"{vessel.name}_" if vessel.name else ""
                areas |= {f"{prefix}area_z{n:02d}": (vessel, n) for n in range(STATIONS)}
                shears |= {f"{prefix}sawss_z{n:02d}": (vessel, n) for n in range(STATIONS)}
                if height := AT_HEIGHT.fullmatch(name.removeprefix(prefix)):
                    areas[name] = vessel, to_si(float(height[1]), "mm")
    if name in areas:
        return Area(system, *areas[name])
    if name in shears:
        vessel, station = shears[name]
        return OfIntegrals(system, Functional("Pa", _shear_at(station), _mean_shear), vessel)
    of_faces = {f"{vessel.name}_tawss" if vessel.name else "tawss": vessel
                for vessel in system.domain.vessels if vessel.lumen}  # fmt: skip
    if name in of_faces:
        return AveragedShear(system, of_faces[name])
    raise CaseError(unknown("quantity with a gradient", name, [*known, *areas, *shears, *of_faces]))


class OfIntegrals(Measured):
    """A function of integrals over the state."""

    def __init__(self, system: System, functional: Functional, vessel: Vessel | None) -> None:
        self.system, self.functional, self.vessel, self.unit = system, functional, vessel, functional.unit
        space = system.unknowns.space
        self._both = ng.FESpace([*space.components, *space.components])
        trial, names = self._both.TrialFunction(), system.unknowns.fields
        state, history = (dict(zip(names, part, strict=True)) for part in (trial[: len(names)], trial[len(names) :]))
        place = Place(system, vessel, state[MOTION], _fields(system, state, history))
        self._forms = {name: self._form([one]) for name, one in functional.integrals(place).items()}
        self._point = ng.GridFunction(self._both)
        self._result = self._point.vec.CreateVector()
        self._known: dict[str, float] = {}

    def _form(self, integrals: Sequence[Integral]) -> ng.BilinearForm:
        form = ng.BilinearForm(self._both, nonassemble=True, check_unused=False)
        for integrands, measure in integrals:
            for integrand in integrands:
                form += ng.Variation(integrand.Compile() * measure)
        return form

    def _integrals(self) -> dict[str, float]:
        values, half = self._point.vec.FV().NumPy(), self.system.unknowns.size
        values[:half] = self.system.values
        values[half:] = self.system.velocity_history.vec.FV().NumPy()
        return {name: float(form.Energy(self._point.vec)) for name, form in self._forms.items()}

    def value(self) -> float:
        self._known = self._integrals()
        return self.under(self.system)

    def under(self, system: System) -> float:
        return float(self.functional.value(system, self.vessel, self._known))

    def gradient(self) -> tuple[Array, Array]:
        self._known = self._integrals()
        integrals, half = self._known, self.system.unknowns.size
        found = np.zeros(2 * half)
        for name, form in self._forms.items():
            step = SMALL * abs(integrals[name] or 1.0)
            slope = np.imag(
                self.functional.value(self.system, self.vessel, integrals | {name: integrals[name] + 1j * step})
            )
            form.Apply(self._point.vec, self._result)
            found += slope / step * np.asarray(self._result.FV().NumPy())
        return found[:half], found[half:]


class AveragedShear(Measured):
    """The wall shear stress at material points, averaged over time and each face of the wall: TAWSS.

    Attributes:
        areas: of the faces of the reference shape (m2).
    """

    unit = "Pa"

    def __init__(self, system: System, vessel: Vessel) -> None:
        self._system, space, faces = system, system.unknowns.space, ng.FacetFESpace(system.domain.mesh, order=0)
        self._all = ng.FESpace([*space.components, *space.components, faces])
        *trial, weight = self._all.TrialFunction()
        names = system.unknowns.fields
        state, history = (dict(zip(names, part, strict=True)) for part in (trial[: len(names)], trial[len(names) :]))
        place = Place(system, vessel, state[MOTION], _fields(system, state, history))
        self._point = ng.GridFunction(self._all)
        on_wall = np.array(list(faces.GetDofs(system.domain.boundaries(vessel.interface))))
        self._faces = 2 * space.ndof + np.flatnonzero(on_wall)
        # of the whole an integral with a weight for each face, whose derivative by the weights are those of the faces
        self._form, size = (self._of(place, vessel, weight * part) for part in (_shear_and_size(place)[0], 1.0))
        self.areas = self._slopes(size)[self._faces]

    def _of(self, place: Place, vessel: Vessel, integrand: Any) -> ng.BilinearForm:
        form = ng.BilinearForm(self._all, nonassemble=True, check_unused=False)
        integrands, measure = place.around(vessel.interface, integrand)
        form += ng.Variation(integrands[0].Compile() * measure)
        return form

    def _slopes(self, form: ng.BilinearForm) -> Array:
        result = self._point.vec.CreateVector()
        form.Apply(self._point.vec, result)
        return np.asarray(result.FV().NumPy()).copy()

    def _all_slopes(self) -> Array:
        values, half = self._point.vec.FV().NumPy(), self._system.unknowns.size
        values[:half] = self._system.values
        values[half : 2 * half] = self._system.velocity_history.vec.FV().NumPy()
        return self._slopes(self._form)

    def record(self) -> Array:
        """Return the integrals of the stress over the faces (N), and their areas."""
        self._known = np.array([self._all_slopes()[self._faces], self.areas])
        return self._known

    def made(self, window: Window, times: Array, records: Array) -> tuple[float, Array]:
        slopes = window.weights(times, np.zeros(len(times)))[1]
        forces, areas = np.tensordot(slopes, records, axes=1)
        if window.kind not in AVERAGES:
            raise CaseError(f"--of tawss: there is {' and '.join(f'tawss_{kind}' for kind in AVERAGES)} over a window")
        value, self._weights = AVERAGES[window.kind](forces, areas)
        self._point.vec.FV().NumPy()[self._faces] = self._weights[0]
        return value, slopes

    def value(self) -> float:
        return self.weighed(self.record())

    def weighed(self, record: Array) -> float:
        return float((self._weights * record).sum())

    def under(self, _system: System) -> Array:
        return self._known

    def gradient(self) -> tuple[Array, Array]:
        slopes, half = self._all_slopes(), self._system.unknowns.size
        self._known = np.array([slopes[self._faces], self.areas])
        return slopes[:half], slopes[half : 2 * half]


def mean_over_faces(forces: Array, areas: Array) -> tuple[float, Array]:
    """Return the mean of forces over areas, and its derivatives (2, faces) by both."""
    whole = areas.sum()
    mean = forces.sum() / whole
    return float(mean), np.array([np.full_like(forces, 1 / whole), np.full_like(forces, -mean / whole)])


def least_of_faces(forces: Array, areas: Array) -> tuple[float, Array]:
    """Return the mean over the area of forces over areas to the power -`SHARPNESS`, in the unit of it, and its
    derivatives (2, faces) by both: that of the smallest, but smooth."""
    stresses, whole = forces / areas, areas.sum()
    powers = (stresses / stresses.min()) ** -SHARPNESS
    sum_of_powers = (areas * powers).sum()
    least = stresses.min() * (sum_of_powers / whole) ** (-1 / SHARPNESS)
    by_stresses = least * areas * powers / stresses / sum_of_powers
    by_areas = -least / SHARPNESS * (powers / sum_of_powers - 1 / whole)
    return float(least), np.array([by_stresses / areas, by_areas - by_stresses * stresses / areas])


AVERAGES = {"mean": mean_over_faces, "least": least_of_faces}
"""What may be made of the stresses of all faces, by the kind of window."""


class Area(Measured):
    """The area of the lumen at a station: its outline moves in the plane with the wall, as of `Sections.area_rates`."""

    unit = "m2"

    def __init__(self, system: System, vessel: Vessel, place: int | float) -> None:
        """Prepare; `place`: the number of the station, or the height along the centreline (m).

        Raises:
            CaseError: the vessel does not reach so far.
        """
        self._system = system
        line = find_centrelines(system.domain, vessel)[0]
        if isinstance(place, float) and not 0 <= place <= line.length:
            raise CaseError(f"{in_unit(place, 'mm')} is not on the centreline of the vessel, from 0 to "
                            f"{in_unit(line.length, 'mm')}")  # fmt: skip
        positions = np.array([place]) if isinstance(place, float) else line.stations(STATIONS)[[place]]
        self._sections = Sections(system, vessel, line, positions)

    def value(self) -> float:
        self._sections.refresh()
        return self.under(self._system)

    def under(self, _system: System) -> float:
        return float(self._sections.areas[0])

    def gradient(self) -> tuple[Array, Array]:
        self._sections.refresh()
        by_motion = self._sections.area_slopes(self._system.unknowns.space.components[0])
        found = np.zeros((2, self._system.unknowns.size))
        found[0, : len(by_motion)] = by_motion
        return found[0], found[1]


def _fields(system: System, state: Named, history: Named) -> Fields | None:
    """Return the blood's fields of trial functions; None: there is no blood."""
    if VELOCITY not in state:
        return None
    assert PRESSURE in state
    # no quantity here is of accelerations, for which the history stands only to be there
    return Fields.of(state, history, history, system.new_weight)
