"""The columns of a run's time series: each quantity is one object from which column, label and meaning follow.

Quantities are registered (`ngfsi.quantities`): a `Quantity` of the system, of each vessel or at a station along each
vessel, or several of them in a tuple. Columns of a vessel other than the first begin with its name. A branched vessel
has stations along the centreline to each outlet, and from each further inlet: the number of the station ends the name,
as in `area_z05_m2`, and on centrelines other than the first the opening's name is before it, as in
`area_outlet_2_z05_m2`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ngfsi import registry
from ngfsi.arrays import Array
from ngfsi.materials.fluid.law import FluidLaw
from ngfsi.measure.branch import Branch
from ngfsi.measure.probe import Probe, VesselProbe
from ngfsi.measure.sections import STATIONS
from ngfsi.measure.shape import Shape


@dataclass(frozen=True)
class Quantity:
    """A number measured at each step, in SI.

    Attributes:
        name: as in the column, without unit.
        unit: suffix of the column, an SI unit; "1" for pure numbers.
        description: for table heads and plots.
        evaluate: value of the present state, of a `Probe`, or of a `VesselProbe` if it is one `of_vessel`, or of a
            `Branch` if it has a `station`.
        applies: whether the model has it.
        of_vessel: whether each vessel has one.
        station: number of the station along each centreline of each vessel at which it is; None: at none.
    """

    name: str
    unit: str
    description: str
    evaluate: Callable[[Any], float]
    applies: Callable[[Any], bool] = lambda _: True
    of_vessel: bool = False
    station: int | None = None

    def column(self, vessel: str = "", branch: str = "") -> str:
        """Return the name of the column in series.csv, of a vessel and, at a station, of one of its centrelines."""
        place = "" if self.station is None else f"z{self.station:02d}"
        return "_".join(filter(None, (vessel, self.name, branch, place, self.unit)))

    def owners(self, probe: Probe) -> Iterator[tuple[str, Any]]:
        """Return column and argument of `evaluate` of each system, vessel or centreline that may have it."""
        if self.station is not None:
            for name, vessel in probe.vessels.items():
                yield from ((self.column(name, branch), along) for branch, along in vessel.branches.items())
        elif self.of_vessel:
            yield from ((self.column(name), vessel) for name, vessel in probe.vessels.items())
        else:
            yield self.column(), probe


def columns(probe: Probe) -> dict[str, Callable[[], float]]:
    """Return what measures the columns of series.csv in the present state, once the probe is refreshed: all quantities
    that are registered and apply, those of the conditions, and those of regions, openings, holes and outlines.

    The last are the smallest volume ratio det F in each region; of each opening the mean pressure of the blood, and
    the flow, in the direction of inlet or outlet, where a vessel has more than one of either; of each hole its pressure
    and volume; in the plane the areas inside of outlines and of regions, and the hydrostatic pressure at the wall's
    outer face on either side. Those of what the blood carries begin with its name.
    """
    found: dict[str, Callable[[], float]] = {}
    for given in registry.everything("ngfsi.quantities", "quantity").values():
        for quantity in [given] if isinstance(given, Quantity) else given:
            found |= {column: partial(quantity.evaluate, owner)
                      for column, owner in quantity.owners(probe) if quantity.applies(owner)}  # fmt: skip
    for condition in probe.system.conditions.values():
        found |= condition.columns()
    found |= {f"detF_min_{name}_1": partial(probe.deformation.smallest_jacobian, name) for name in probe.domain.regions}
    for vessel in probe.vessels.values():
        for name in vessel.vessel.openings:
            found[f"pressure_{name}_Pa"] = partial(vessel.mean_pressure, name)
            if vessel.vessel.branched:
                found[f"flow_{name}_m3_s"] = partial(_flow, vessel, name)
    for name, hole in probe.holes.items():
        prefix = f"{name}_" if name else ""
        found[f"pressure_{hole.vessel.interface}_Pa"] = hole.pressure
        found[f"{prefix}lumen_volume_m3"] = hole.volume
        found[f"{prefix}lumen_area_mean_m2"] = partial(lambda one: one.volume() / one.length, hole)
    if probe.scalars:
        found |= probe.scalars.columns()
    if plane := probe.plane:
        found |= {f"{name}_area_m2": partial(plane.enclosed_area, name) for name in plane.outlines}
        found |= {f"{name}_area_m2": partial(plane.region_area, name) for name in probe.domain.regions}
        found |= {f"p_{side}_side_Pa": partial(plane.pressure_over, str(plane.outer), region)
                  for side, region in plane.sides.items()}  # fmt: skip
    return found


def _flow(p: VesselProbe, opening: str) -> float:
    return p.integral(f"flux {opening}") * (-1.0 if opening in p.vessel.inlets else 1.0)


def _reynolds(p: VesselProbe) -> float:
    return max(_largest_reynolds(p.system.blood, branch) for branch in p.branches.values())


def _largest_reynolds(blood: FluidLaw, branch: Branch) -> float:
    flows, areas = np.abs(branch.flows), branch.sections.areas
    diameters = np.sqrt(4 * areas / np.pi)
    viscosity = blood.developed_viscosity(_round_rates(flows, areas))
    return float(np.nanmax(blood.density * flows / areas * diameters / viscosity))


def _round_rates(flows: Array, areas: Array) -> Array:
    """Return the wall shear rates (1/s) of developed flows of constant viscosity in round pipes, 4 Q / (pi R^3)."""
    return np.asarray(4 * np.abs(flows) / (np.pi * (areas / np.pi) ** 1.5))


def _developed(p: VesselProbe, flows: Array, shape: Shape | None = None) -> float:
    """Return the SAWSS (Pa) of developed flow: 4 mu Q / (pi R^3), and for ellipses tau perimeter = G area with the
    pressure gradient G = 4 mu Q (a^2 + b^2) / (pi a^3 b^3).

    Where the viscosity depends on the shear rate, mu is that of a round pipe with the same mean of the wall shear rate:
    exact in circles, and 1 % off in an ellipse of 2 : 1 (tests/materials/test_fluids.py).
    """
    sections = p.sections
    if shape is None:
        rates = _round_rates(flows, sections.areas)
    else:
        a, b = shape.major, shape.minor
        rates = 4 * np.abs(flows) * (a**2 + b**2) / (a**2 * b**2 * shape.perimeter)
    return sections.mean_over_wall(p.system.blood.developed_viscosity(rates) * rates)


def _along(
    name: str, unit: str, description: str, values: Callable[[Any], Array], **more: Any
) -> list[Quantity]:  # fmt: skip
    """Return a quantity at each station along the centrelines; `{}` in the description is its number."""

    def at(index: int) -> Quantity:
        return Quantity(name, unit, description.format(index), lambda branch: float(values(branch)[index]),
                        station=index, **more)  # fmt: skip

    return [at(index) for index in range(STATIONS)]


_of_vessel = partial(Quantity, of_vessel=True)


def _given_outlet(p: VesselProbe) -> float:
    condition: Any = p.system.conditions[p.vessel.outlets[0]]
    return float(condition.given_pressure())


def _has_given_outlet(p: VesselProbe) -> bool:
    return hasattr(p.system.conditions[p.vessel.outlets[0]], "given_pressure")


def _has_load(p: VesselProbe | Branch) -> bool:
    return p.load is not None


def _branched(p: VesselProbe | Branch) -> bool:
    return p.vessel.branched


def _unbranched(p: VesselProbe) -> bool:
    return not _branched(p)


SYSTEM: tuple[Quantity, ...] = (
    Quantity("skin_pressure", "Pa", "pressure everywhere on the skin, without cuffs",
             lambda p: p.given("on the skin"), lambda p: p.pressed),
    Quantity("skin_pressure_mean", "Pa", "pressure on the skin, cuffs included, mean over its area",
             lambda p: p.mean_skin_pressure(), lambda p: p.pressed),
    Quantity("skin_pressure_max", "Pa", "largest pressure on the skin, cuffs included",
             lambda p: p.largest_skin_pressure(), lambda p: p.pressed),
    Quantity("displacement_max", "m", "largest displacement of the solids",
             lambda p: p.deformation.largest_displacement(), lambda p: bool(p.system.solids)),
)  # fmt: skip

VESSEL: tuple[Quantity, ...] = (
    _of_vessel("outlet_pressure", "Pa", "blood pressure at the outlet", _given_outlet, _has_given_outlet),
    _of_vessel("lumen_volume", "m3", "volume of the lumen", lambda p: p.integral("lumen volume")),
    _of_vessel("lumen_area_mean", "m2", "volume of the lumen over the length of the vessel",
               lambda p: p.integral("lumen volume") / p.sections.line.length, _unbranched),
    *_along("area", "m2", f"lumen area at station {{}} of 0 (inlet) to {STATIONS - 1} (outlet)",
            lambda p: p.sections.areas),
    _of_vessel("sawss", "Pa", "wall shear stress, mean over the deformed wall", lambda p: p.shear.mean),
    _of_vessel("wss_min", "Pa", "smallest wall shear stress", lambda p: p.shear.smallest),
    _of_vessel("wss_max", "Pa", "largest wall shear stress", lambda p: p.shear.largest),
    _of_vessel("wss_low_area", "1", "fraction of the wall's area with low wall shear stress", lambda p: p.shear.low),
    *_along("wss", "Pa", "wall shear stress, mean around station {}", lambda p: p.sections.shears),
    *_along("flow", "m3_s", "flow through station {}, towards the outlet", lambda p: p.flows, applies=_branched),
    *_along("p_blood", "Pa", "pressure of the blood on the axis at station {}", lambda p: p.sections.blood),
    *_along("p_transmural", "Pa", "pressure of the blood less that of the tissue on the wall (normal traction), at "
            "station {}", lambda p: p.sections.blood - p.load.tissue, applies=_has_load),
    _of_vessel("sawss_consistent", "Pa", "SAWSS from the balance of momentum instead of the gradient of the velocity",
               lambda p: p.consistent_shear.mean),
    _of_vessel("sawss_poiseuille_inlet", "Pa",
               "SAWSS of developed flow with the same local area and the flow of the inlet",
               lambda p: _developed(p, np.full_like(p.sections.areas, p.inflow())), _unbranched),
    _of_vessel("sawss_poiseuille_local", "Pa", "SAWSS of developed flow with the same local area and flow",
               lambda p: _developed(p, p.branches[""].flows), _unbranched),
    _of_vessel("sawss_ellipse_local", "Pa",
               "SAWSS of developed flow in ellipses with the same local area, axes and flow",
               lambda p: _developed(p, p.branches[""].flows, Shape.of(p.sections)), _unbranched),
    _of_vessel("p_tissue_side", "Pa", "hydrostatic pressure at the outer face of the vein wall, tissue side",
               lambda p: p.solid_pressure(str(p.outside), "outer"), _has_load),
    _of_vessel("p_wall_side", "Pa", "hydrostatic pressure at the outer face of the vein wall, wall side",
               lambda p: p.solid_pressure(str(p.vessel.wall), "outer"), _has_load),
    _of_vessel("p_wall_mean", "Pa", "hydrostatic pressure, mean over the vein wall",
               lambda p: p.solid_pressure(str(p.vessel.wall)), lambda p: p.vessel.wall is not None),
    _of_vessel("flow_in", "m3_s", "flow through the inlet", lambda p: p.inflow()),
    _of_vessel("flow_out", "m3_s", "flow through the outlet", lambda p: p.outflow()),
    _of_vessel("lumen_volume_rate", "m3_s", "rate of the lumen's volume", lambda p: p.integral("lumen rate")),
    _of_vessel("mass_defect", "m3_s", "rate of the lumen's volume + outflow - inflow",
               lambda p: p.integral("lumen rate") + p.outflow() - p.inflow()),
    _of_vessel("reynolds", "1", "largest Reynolds number of the sections (Metzner and Reed's, if the blood thins)",
               _reynolds),
)  # fmt: skip
