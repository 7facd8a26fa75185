"""Runs that were never computed: an analytic contraction of the vein, stored through the real RunFolder."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import ngsolve as ng
import numpy as np
from ngfsi_geometry.calf import CalfSegment
from ngfsi_geometry.segment import MeshSettings
from numpy.typing import NDArray

from ngfsi.case import Case, Loads, Materials, Output, TimeStepping
from ngfsi.config.functions import PressureRamp
from ngfsi.materials import load_set
from ngfsi.measure.quantities import SYSTEM, VESSEL
from ngfsi.measure.wall import WallSample
from ngfsi.mesh.domain import Domain
from ngfsi.store.fields import FieldWriter
from ngfsi.store.folder import RunFolder, outline_rows
from ngfsi.store.stored import StoredRun, open_run
from ngfsi.units import MMHG

GEOMETRY = CalfSegment(mesh=MeshSettings(axial_layers=2, vein_size=8e-3, far_size=25e-3, lumen_radii=(0.6,)))
MATERIALS = Materials(tissue=load_set("mooney_rivlin_s1"), wall=load_set("vein_wall_source"), fluid=load_set("blood"))
CASE = Case(
    name="fake",
    geometry=GEOMETRY,
    materials=MATERIALS,
    loads=Loads(skin_pressure=PressureRamp(final=25 * MMHG, duration=1.0)),
    time=TimeStepping(step=0.25, end=1.5),
    output=Output(fields_every=0),
)
INFLATION = 1.1
"""Area at t = 0 over the area of the unloaded shape."""


@cache
def domain() -> Domain:
    return Domain.build(GEOMETRY)


def fake_run(
    path: Path, case: Case = CASE, *, loss: float = 0.25, status: str = "completed", **further: ng.CF
) -> StoredRun:
    """Store a run whose lumen loses the share `loss` of its area during the ramp, with `further` fields."""
    folder = RunFolder.create(path, case)
    folder.update_manifest(
        reference={"lumen_volume_m3": unloaded_area() * GEOMETRY.length},
        mesh=domain().statistics(),
        unknowns=1234,
        peak_memory_MB=512.5,
        seconds={"mesh": 0.5, "steps": 6.0},
    )
    displacement = ng.GridFunction(ng.VectorH1(domain().mesh, order=2))
    writer = FieldWriter(path, domain(), {"displacement_m": displacement, "pressure_Pa": ng.CF(1333.0),
                                            "hydrostatic_pressure_Pa": 1e5 * ng.x, **further})  # fmt: skip
    for number, time in enumerate(np.arange(0, case.time.end + 1e-9, case.time.step)):
        stretch = np.sqrt(INFLATION * (1 - loss * min(time, 1.0)))
        folder.append("series", _row(case, time, stretch))
        folder.append("outlines", *outline_rows({"time_s": time}, _rings(stretch)))
        folder.append("shape", *_shape(time, stretch))
        if number:
            folder.append(
                "costs", {"step": number, "time_s": time, "iterations": 4, "factorisations": 1, "wall_s": 0.5}
            )
        writer.write_wall(time, wall_sample(stretch))
        if number == 0 or time >= case.time.end - 1e-9:
            displacement.Set(_contraction(stretch))
            writer.write(time)
    folder.finish(status, "" if status == "completed" else "the step at 1.5 s did not converge")  # type: ignore[arg-type]
    return open_run(path)


def unloaded_area() -> float:
    return float(np.pi * GEOMETRY.lumen_radius**2)


def _row(case: Case, time: float, stretch: float) -> dict[str, float]:
    """Every column of a real run of a vein without branches; of those that matter to a report the values of a
    contracting tube."""
    area = unloaded_area() * stretch**2
    sawss = 4 * 3.5e-3 * 2.913e-6 / (np.pi * (GEOMETRY.lumen_radius * stretch) ** 3)
    given = {
        "skin_pressure_Pa": case.loads.skin_pressure(time),
        "outlet_pressure_Pa": case.loads.outlet_pressure(time),
        "lumen_volume_m3": area * GEOMETRY.length,
        "lumen_area_mean_m2": area,
        "sawss_Pa": sawss * (1.5 if 0 < time <= 1 else 1.0),
        "sawss_poiseuille_inlet_Pa": sawss,
        "sawss_poiseuille_local_Pa": sawss * (1.3 if 0 < time <= 1 else 1.0),
        "sawss_ellipse_local_Pa": sawss * (1.35 if 0 < time <= 1 else 1.0),
        "wss_min_Pa": 0.5 * sawss,
        "wss_max_Pa": 2 * sawss,
        "p_tissue_side_Pa": 3000.0 * time,
        "p_wall_side_Pa": 5000.0 * time,
        "p_wall_mean_Pa": 4000.0 * time,
    }
    given |= {f"skin_pressure_{which}_Pa": case.loads.skin_pressure(time) for which in ("mean", "max")}
    skin, blood = case.loads.skin_pressure(time), case.loads.outlet_pressure(time)
    for station in range(11):
        given[f"area_z{station:02d}_m2"] = area
        given[f"p_blood_z{station:02d}_Pa"] = blood
        given[f"p_transmural_z{station:02d}_Pa"] = blood - 0.8 * skin
    columns = [name for quantity in (*SYSTEM, *VESSEL) if not (name := quantity.column()).startswith("flow_z")]
    columns += [f"detF_min_{region}_1" for region in ("tissue", "wall", "fluid")]
    return {"time_s": time, "step_s": case.time.step if time else 0.0} | {c: given.get(c, 1.0) for c in columns}


def _rings(stretch: float) -> NDArray[np.float64]:
    angles = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    x0, y0 = GEOMETRY.vein_centre
    radius = GEOMETRY.lumen_radius * stretch
    ring = np.column_stack([x0 + 1.05 * radius * np.cos(angles), y0 + radius / 1.05 * np.sin(angles), 0 * angles])
    return np.array([np.add(ring, (0, 0, z)) for z in np.linspace(0, GEOMETRY.length, 11)])


def _shape(time: float, stretch: float) -> list[dict[str, float]]:
    radius = GEOMETRY.lumen_radius * stretch
    return [
        {"time_s": time, "station": i, "centre_z_m": z, "area_m2": np.pi * radius**2, "circularity_1": 0.99}
        for i, z in enumerate(np.linspace(0, GEOMETRY.length, 11))
    ]


def _contraction(stretch: float) -> ng.CF:
    """Displacement (1 - stretch) R towards the vein's axis at its wall, decaying as 1/r outside."""
    (x0, y0), radius = GEOMETRY.vein_centre, GEOMETRY.lumen_radius
    squared = (ng.x - x0) ** 2 + (ng.y - y0) ** 2
    share = ng.IfPos(squared - radius**2, radius**2 / squared, 1.0)
    return ng.CF((ng.x - x0, ng.y - y0, 0)) * (stretch - 1) * share


def wall_sample(stretch: float) -> WallSample:
    around, along = 25, 13
    angle, z = np.meshgrid(np.linspace(0, 2 * np.pi, around), np.linspace(0, GEOMETRY.length, along))
    (x0, y0), radius = GEOMETRY.vein_centre, GEOMETRY.lumen_radius * stretch
    points = np.column_stack([(x0 + radius * np.cos(angle)).ravel(), (y0 + radius * np.sin(angle)).ravel(), z.ravel()])
    first = np.array([j * around + i for j in range(along - 1) for i in range(around - 1)])
    quads = np.column_stack([first, first + 1, first + around + 1, first + around])
    shear = np.zeros_like(points)
    shear[:, 2] = 0.08 / stretch**3 * (1 + 0.3 * z.ravel() / GEOMETRY.length)
    return WallSample(points, quads, shear, np.full(len(points), 1333.0), shear[:, [2, 0]])
