"""Pictures of geometries that are made from outlines."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ngfsi_geometry.lofted_calf import CalfLoft

COLUMNS = 6


def draw_sections(calf: CalfLoft, file: Path) -> None:
    """Draw in each slice the outlines, or edges of labels, that are given and the section of the smooth surfaces."""
    from matplotlib.figure import Figure  # takes long to load, which other commands need not wait for

    sections = list(calf.sections())
    columns = min(COLUMNS, len(sections))
    rows = -(-len(sections) // columns)
    figure = Figure(figsize=(2 * columns, 2 * rows), layout="constrained")
    axes = np.ravel(figure.subplots(rows, columns))
    for one in axes:
        one.set_axis_off()
        one.set_aspect("equal")
    for k, (one, section) in enumerate(zip(axes, sections, strict=False)):
        one.set_title(f"slice {calf.stack.first + k}", fontsize=8)
        for part in calf.stack.outlines:
            one.plot(*calf.edge(part, k).T, ".", color="0.6", markersize=0.15)
        for outline in section.values():
            one.fill(*outline.points.T, fill=False, edgecolor="C0", linewidth=0.8)
    figure.savefig(file, dpi=110)
