"""Commands of `ngfsi` for images and outlines."""

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


def outlines(
    case: Annotated[Path, typer.Argument(help="Case file of a calf from outlines or a label map.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write to.")] = Path("runs/outlines"),
) -> None:
    """Hold the smooth surfaces of a lofted calf against its outlines or labels, slice by slice.

    Writes deviations.csv and a picture of each slice, sections.png.

    Example: ngfsi outlines leg.toml -o leg-outlines
    """
    from ngfsi.case import Case
    from ngfsi.errors import GeometryError
    from ngfsi.mesh.domain import Domain
    from ngfsi.store.disk import explained
    from ngfsi.store.table import write_rows
    from ngfsi.units import from_si, in_unit
    from ngfsi_geometry.lofted_calf import CalfLoft
    from ngfsi_geometry.pictures import draw_sections

    calf = Case.from_toml(case).geometry
    if not isinstance(calf, CalfLoft):
        raise GeometryError(
            f"the geometry of '{case}' has no outlines: give a case of type lofted_calf or labelled_calf"
        )
    rows = calf.deviations()
    with explained(output):
        output.mkdir(parents=True, exist_ok=True)
        draw_sections(calf, output / "sections.png")
    write_rows(output / "deviations.csv", rows)
    for part in dict.fromkeys(str(row["part"]) for row in rows):
        mine = [row for row in rows if row["part"] == part]
        worst = max(mine, key=lambda row: float(row["distance_max_m"]))
        whole = sum(float(row["area_m2"]) * (1 + float(row["area_error_1"])) for row in mine)
        area = whole / sum(float(row["area_m2"]) for row in mine) - 1
        away = from_si(float(worst["distance_max_m"]), "mm")
        typer.echo(f"{part}: area {area:+z.2%} over all slices, at most {away:.2f} mm off (slice {worst['slice']})")
    for sentence in calf.remarks:
        typer.echo(f"warning: {sentence}")
    if calf.further_regions:
        domain = Domain.build(calf)
        for name, volume in calf.label_volumes().items():
            meshed = domain.volume(name)
            both = f"{in_unit(meshed, 'ml', '.3g')} in the mesh, {in_unit(volume, 'ml', '.3g')} labelled"
            typer.echo(f"{name}: {both} ({meshed / volume - 1:+.1%})")
    typer.echo(f"All slices are in '{output}': deviations.csv, sections.png")
