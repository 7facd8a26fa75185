"""The columns of a run's time series: each quantity is one object from which column, label and meaning follow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ngfsi.measure.probe import Probe
from ngfsi.measure.sections import STATIONS
from ngfsi.measure.shape import Shape


@dataclass(frozen=True)
class Quantity:
    """A number measured at each step, in SI.

    Attributes:
        name: as in the column, without unit.
        unit: suffix of the column, an SI unit; "1" for pure numbers.
        description: for table heads and plots.
        evaluate: value of the present state.
    """

    name: str
    unit: str
    description: str
    evaluate: Callable[[Probe], float]

    @property
    def column(self) -> str:
        """Name of the column in series.csv."""
        return f"{self.name}_{self.unit}"


def _reynolds(probe: Probe) -> float:
    blood = probe.system.blood
    areas = probe.sections.areas
    flows = np.abs(probe.sections.local_flows(_inflow(probe)))
    diameters = np.sqrt(4 * areas / np.pi)
    return float(np.max(blood.density * flows / areas * diameters / blood.nominal_viscosity))


def _developed(probe: Probe, flows: NDArray[np.float64], shape: Shape | None = None) -> float:
    """Return the SAWSS (Pa) of developed flow: 4 mu Q / (pi R^3), and for ellipses tau perimeter = G area with the
    pressure gradient G = 4 mu Q (a^2 + b^2) / (pi a^3 b^3)."""
    sections, viscosity = probe.sections, probe.system.blood.nominal_viscosity
    if shape is None:
        return sections.mean_over_wall(4 * viscosity * np.abs(flows) / (np.pi * (sections.areas / np.pi) ** 1.5))
    a, b = shape.major, shape.minor
    return sections.mean_over_wall(4 * viscosity * np.abs(flows) * (a**2 + b**2) / (a**2 * b**2 * shape.perimeter))


def _inflow(probe: Probe) -> float:
    return -probe.integral("flux inlet")


def _along(name: str, unit: str, description: str, values: Callable[[Probe], NDArray[np.float64]]) -> list[Quantity]:
    """Return a quantity at each station along the vein; `{}` in the description is its number."""

    def at(index: int) -> Quantity:
        return Quantity(
            f"{name}_z{index:02d}", unit, description.format(index), lambda probe: float(values(probe)[index])
        )

    return [at(index) for index in range(STATIONS)]


def _jacobian(region: str) -> Quantity:
    return Quantity(
        f"detF_min_{region}",
        "1",
        f"smallest volume ratio det F in {region}",
        lambda probe: probe.deformation.smallest_jacobian(region),
    )


QUANTITIES: tuple[Quantity, ...] = (
    Quantity("skin_pressure", "Pa", "pressure on the skin", lambda p: p.given("on the skin")),
    Quantity("outlet_pressure", "Pa", "blood pressure at the outlet", lambda p: p.given("outlet")),
    Quantity("lumen_volume", "m3", "volume of the lumen", lambda p: p.integral("lumen volume")),
    Quantity(
        "lumen_area_mean",
        "m2",
        "volume of the lumen over the length of the segment",
        lambda p: p.integral("lumen volume") / p.vein.length,
    ),
    *_along(
        "area",
        "m2",
        f"lumen area at station {{}} of 0 (inlet) to {STATIONS - 1} (outlet)",
        lambda p: p.sections.areas,
    ),
    Quantity("sawss", "Pa", "wall shear stress, mean over the deformed wall", lambda p: p.shear.mean),
    Quantity("wss_min", "Pa", "smallest wall shear stress", lambda p: p.shear.smallest),
    Quantity("wss_max", "Pa", "largest wall shear stress", lambda p: p.shear.largest),
    Quantity("wss_low_area", "1", "share of the wall's area with low wall shear stress", lambda p: p.shear.low),
    *_along("wss", "Pa", "wall shear stress, mean around station {}", lambda p: p.sections.shears),
    *_along("p_blood", "Pa", "pressure of the blood on the axis at station {}", lambda p: p.load.blood),
    *_along(
        "p_transmural",
        "Pa",
        "pressure of the blood less that of the tissue on the wall (normal traction), at station {}",
        lambda p: p.load.blood - p.load.tissue,
    ),
    Quantity(
        "sawss_consistent",
        "Pa",
        "SAWSS from the balance of momentum instead of the gradient of the velocity",
        lambda p: p.consistent_shear.mean,
    ),
    Quantity(
        "sawss_poiseuille_inlet",
        "Pa",
        "SAWSS of developed flow with the same local area and the flow of the inlet",
        lambda p: _developed(p, np.full_like(p.sections.areas, _inflow(p))),
    ),
    Quantity(
        "sawss_poiseuille_local",
        "Pa",
        "SAWSS of developed flow with the same local area and flow",
        lambda p: _developed(p, p.sections.local_flows(_inflow(p))),
    ),
    Quantity(
        "sawss_ellipse_local",
        "Pa",
        "SAWSS of developed flow in ellipses with the same local area, axes and flow",
        lambda p: _developed(p, p.sections.local_flows(_inflow(p)), Shape.of(p.sections)),
    ),
    Quantity(
        "p_tissue_side",
        "Pa",
        "hydrostatic pressure at the outer face of the vein wall, tissue side",
        lambda p: p.solid_pressure("tissue", "wall_outer"),
    ),
    Quantity(
        "p_wall_side",
        "Pa",
        "hydrostatic pressure at the outer face of the vein wall, wall side",
        lambda p: p.solid_pressure("wall", "wall_outer"),
    ),
    Quantity("p_wall_mean", "Pa", "hydrostatic pressure, mean over the vein wall", lambda p: p.solid_pressure("wall")),
    Quantity("flow_in", "m3_s", "flow through the inlet", _inflow),
    Quantity("flow_out", "m3_s", "flow through the outlet", lambda p: p.integral("flux outlet")),
    Quantity("lumen_volume_rate", "m3_s", "rate of the lumen's volume", lambda p: p.integral("lumen rate")),
    Quantity(
        "mass_defect",
        "m3_s",
        "rate of the lumen's volume + outflow - inflow",
        lambda p: p.integral("lumen rate") + p.integral("flux outlet") + p.integral("flux inlet"),
    ),
    Quantity("reynolds", "1", "largest Reynolds number of the sections", _reynolds),
    Quantity(
        "displacement_max", "m", "largest displacement of the solids", lambda p: p.deformation.largest_displacement()
    ),
    *(_jacobian(name) for name in ("tissue", "wall", "fluid")),
)


def row(probe: Probe) -> dict[str, float]:
    """Return all quantities of the present state by column; refresh the probe first."""
    return {quantity.column: quantity.evaluate(probe) for quantity in QUANTITIES}
