"""Commands of `ngfsi` for images."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def register(
    fixed: Annotated[Path, typer.Argument(help="Image before: NIfTI, NRRD, or a folder with a DICOM series.")],
    moving: Annotated[Path, typer.Argument(help="Image after.")],
    number: Annotated[int, typer.Option("--slice", help="Number of the slice, from 0, distal.")],
    moving_number: Annotated[
        int | None, typer.Option("--moving-slice", help="Of the image after; default the same.", show_default=False)
    ] = None,
    control_mm: Annotated[float, typer.Option(min=1, help="Distance of the B-splines' control points [mm].")] = 25.0,
    output: Annotated[Path, typer.Option("--output", "-o", help="CSV file to write.")] = Path("runs/skin.csv"),
) -> None:
    """Find the motion of the skin between two images.

    Of a slice of label maps or grey images, by B-splines. The file is a condition of plane sections:
    skin_displacement = { file = "skin.csv" }.

    Example: ngfsi register before.nii.gz after.nii.gz --slice 12 -o skin.csv
    """
    from ngfsi.store.disk import explained
    from ngfsi.store.table import write_rows
    from ngfsi.units import from_si, to_si
    from ngfsi_geometry import registering as images

    before = images.slice_of(fixed, number)
    after = images.slice_of(moving, number if moving_number is None else moving_number)
    found = images.register_slices(before, after, to_si(control_mm, "mm"))
    with explained(output):
        output.parent.mkdir(parents=True, exist_ok=True)
    write_rows(output, found.rows())
    rms, largest = (from_si(gap, "mm") for gap in images.gap_to(found, after.skin))
    typer.echo(
        f"The motion of the skin is in '{output}'; moved so, it lies {rms:.2f} mm (rms) and at most {largest:.2f} mm "
        "beside the skin in the image after"
    )
