"""Which elements and which order for the calf? Errors of lumen area and wall shear against the cost of a run.

The ramp of `compare_tissues` in ten steps, so that all runs have the same error in time and differ in space alone. Each
is held against one run with many more unknowns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from ngfsi_geometry.segment import MeshSettings

from ngfsi.case import Case
from ngfsi.errors import NgfsiError
from ngfsi.report.figures import Convergence, convergence
from ngfsi.report.tables import markdown_table
from ngfsi.store.stored import StoredRun, mean_over_steps
from ngfsi.study import Study, run_study, write_page
from ngfsi.units import Shown, from_si, in_unit
from ngfsi_studies.compare_tissues import LEVELS, MAIN, case, mesh

STEPS = 10
FIGURE = "discretisation.png"


class Family(NamedTuple):
    """Elements of one kind and order.

    Attributes:
        layered: whether the lumen's elements are thin at the wall.
        sizes: of the elements, as in `compare_tissues.mesh`.
    """

    element: str
    order: int
    sizes: tuple[float, ...]
    bulk: str = "full"
    layered: bool = True

    @property
    def title(self) -> str:
        """What it is, in words."""
        kind = {"mixed": "hexahedra and prisms", "prism": "prisms", "tetrahedron": "tetrahedra"}[self.element]
        extra = ("" if self.bulk == "full" else ", reduced bulk integration") + ("" if self.layered else ", no layers")
        return f"{kind}, k = {self.order}{extra}"


FAMILIES = (
    Family("mixed", 2, (1.5, 1.2, 1.0, 0.75)),
    Family("mixed", 2, (1.5, 1.2, 1.0, 0.75), bulk="reduced"),
    Family("mixed", 2, (1.5, 1.2, 1.0), layered=False),
    Family("mixed", 3, (2.0, 1.5, 1.2)),
    Family("mixed", 3, (2.0, 1.5), bulk="reduced"),
    Family("mixed", 4, (3.0,)),
    Family("prism", 2, (1.5, 1.0)),
    Family("prism", 3, (2.0, 1.5)),
    Family("tetrahedron", 2, (1.5, 1.0)),
    Family("tetrahedron", 3, (2.0, 1.5)),
)
FINEST = {"demo": (Family("mixed", 3, (1.2,)), 1.2), "paper": (Family("mixed", 4, (2.0,)), 0.0)}
"""By level: what all are held against, and the smallest size that is computed."""

TITLES = {"area": "error of the lumen's mean area", "sawss": "error of the SAWSS, mean over the ramp"}
MEASURES = {"area": "lumen_area_mm2", "loss": "loss_percent", "sawss": "sawss_Pa", "largest": "wss_max_Pa"}
"""What has an error -> its column."""
WANTED = {"area": 1e-3, "sawss": 1e-2}
"""Relative errors that the elements of a level of `compare_tissues` should not exceed."""

COLUMNS: Mapping[str, Callable[[StoredRun], float]] = {
    "unknowns": lambda run: run.manifest["unknowns"],
    "cpu_s": lambda run: run.manifest["cpu_s"],
    "peak_memory_MB": lambda run: run.manifest["peak_memory_MB"],
    "lumen_area_mm2": lambda run: from_si(run.series["lumen_volume_m3"][-1] / run.case.geometry.length, "mm2"),
    "loss_percent": lambda run: from_si(
        1 - run.series["lumen_volume_m3"][-1] / run.series["lumen_volume_m3"][0], "percent"
    ),
    "sawss_Pa": lambda run: mean_over_steps(run.series, "sawss_Pa"),
    "wss_max_Pa": lambda run: mean_over_steps(run.series, "wss_max_Pa"),
}


def elements(family: Family, size: float) -> MeshSettings:
    """Return mesh settings of a family, at a size as in `compare_tissues.mesh`."""
    return mesh(size, family.order, layered=family.layered).replace(element=family.element)


def ramp(family: Family, size: float) -> Case:
    """Return the ramp with elements of a family and size."""
    plain = case(MAIN[0], LEVELS["demo"])
    end = max(plain.loads.breakpoints)
    return plain.replace(
        geometry=plain.geometry.replace(mesh=elements(family, size)),
        **{"discretisation.order": family.order, "discretisation.bulk_integration": family.bulk,
           "time.step": end / STEPS, "time.end": end, "output.fields_every": 0},
    )  # fmt: skip


def study(level: str, folder: Path, quiet: bool = False) -> Path:
    """Run the comparison into a folder and return the path of the report."""
    best, smallest = FINEST.get(level, FINEST["paper"])
    chosen = [(family, [size for size in family.sizes if size >= smallest]) for family in FAMILIES]
    cases = {
        _key(family, size): ramp(family, size) for family, sizes in (*chosen, (best, best.sizes)) for size in sizes
    }
    results = run_study(Study("runs", cases, COLUMNS), folder, quiet=quiet)
    reference = _key(best, best.sizes[0])
    if reference not in results.table:
        raise NgfsiError(f"the run that all are held against failed: {results.outcomes[reference].failure}")
    errors = {key: errors_of(row, results.table[reference]) for key, row in results.table.items() if key != reference}
    lines: dict[str, list[Convergence]] = {name: [] for name in TITLES}
    for family, sizes in chosen:
        found = [key for key in (_key(family, size) for size in sizes) if key in errors]
        for name in TITLES if found else ():
            seconds = [results.table[key]["cpu_s"] for key in found]
            lines[name].append(Convergence(family.title, seconds, [errors[key][name] for key in found]))
    panels = {TITLES[name]: drawn for name, drawn in lines.items()}
    convergence(panels, folder / FIGURE, (Shown("CPU time of a run, one thread", "s"), Shown("error", "percent")),
                {TITLES[name]: WANTED[name] for name in TITLES})  # fmt: skip
    return write_page(folder, "discretisation", level, _text(level, results.table, errors, reference))


def _key(family: Family, size: float) -> str:
    return f"{family.title}, size {size:g}"


def errors_of(row: Mapping[str, float], reference: Mapping[str, float]) -> dict[str, float]:
    """Return by how much a run is off another, relative: area, loss of volume, SAWSS and largest wall shear."""
    return {name: abs(row[column] / reference[column] - 1) for name, column in MEASURES.items()}


def _text(level: str, table: Mapping[str, Mapping[str, float]], errors: Mapping[str, Mapping[str, float]],
          reference: str) -> Sequence[str]:  # fmt: skip
    head = ("elements", "unknowns", "CPU (s)", "memory (MB)", "area (mm2)", "error (%)", "loss (%)", "error (%)",
            "SAWSS (Pa)", "error (%)", "largest wall shear (Pa)", "error (%)")  # fmt: skip
    rows = []
    for key, row in sorted(table.items(), key=lambda item: item[1]["cpu_s"]):
        off = [f"{from_si(errors[key][name], 'percent'):.2g}" if key in errors else "" for name in MEASURES]
        rows.append((key, f"{row['unknowns']:,.0f}", f"{row['cpu_s']:.1f}", f"{row['peak_memory_MB']:.0f}",
                     f"{row['lumen_area_mm2']:.3f}", off[0], f"{row['loss_percent']:.3f}", off[1],
                     f"{row['sawss_Pa']:.5f}", off[2], f"{row['wss_max_Pa']:.5f}", off[3]))  # fmt: skip
    return (
        f"# Elements for the calf, level `{level}`\n",
        answer(table, errors) + "\n",
        f"![errors over time]({FIGURE})\n",
        f"M tissue under 25 mmHg in {STEPS} steps of 0.1 s, the same for all, so that they differ by their error "
        "in space alone. Area and loss are those at the end of the ramp, SAWSS and the largest wall shear means "
        "over the ramp; errors are distances "
        f"from {reference} (no errors in its row). Size 1 is 25 mm in the tissue and 3.2 mm at the vein; `layers` "
        "are elements thin at the wall of the lumen. CPU times are of the whole process with one thread.\n",
        markdown_table(head, rows),
    )


def answer(table: Mapping[str, Mapping[str, float]], errors: Mapping[str, Mapping[str, float]]) -> str:
    """Return a sentence that names the cheapest elements that are good enough."""
    wanted = f"{in_unit(WANTED['area'], 'percent')} in area and {in_unit(WANTED['sawss'], 'percent')} in SAWSS"
    good = [key for key, found in errors.items() if all(found[name] <= WANTED[name] for name in WANTED)]
    if not good:
        return f"No elements are within {wanted}."
    cheapest = min(good, key=lambda key: table[key]["cpu_s"])
    return (
        f"The cheapest elements within {wanted} are **{cheapest}**, with {table[cheapest]['unknowns']:,.0f} unknowns "
        f"and {table[cheapest]['cpu_s']:.0f} s."
    )
