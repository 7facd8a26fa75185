"""Case files to begin with, for `ngfsi new`: their text, and what example files they need."""

from __future__ import annotations

from functools import partial
from importlib.resources import files
from pathlib import Path

import numpy as np

QUARTER = np.pi / 2
MESH, IMAGE = "vein.msh", "leg.seg.nrrd"
"""Example files, which the texts name."""


def _text(name: str, _: Path | None = None) -> str:
    return files(__name__).joinpath(f"{name}.toml").read_text(encoding="utf-8")


calf, vein, wall, rigid, solid, section = (
    partial(_text, name) for name in ("calf", "vein", "wall", "rigid", "solid", "section")
)


def mesh(folder: Path | None) -> str:
    """Return the case of a mesh from a file, an example of which is written into `folder`, if one is given."""
    if folder:
        _write_bent_vein(folder / MESH)
    return _text("mesh")


def image(folder: Path | None) -> str:
    """Return the case of a segmented image, an example of which is written into `folder`, if one is given."""
    if folder:
        import SimpleITK as sitk  # noqa: N813 - its usual name

        from ngfsi_geometry.example_labels import rough_calf

        sitk.WriteImage(rough_calf(), folder / IMAGE)
    return _text("image")


def _write_bent_vein(path: Path) -> None:
    """Write a vein with its wall, of curved cells, bent by a quarter of a circle, in mm, for Gmsh."""
    from ngfsi.mesh.domain import Domain
    from ngfsi.store.export import of_domain, write
    from ngfsi.units import from_si
    from ngfsi_geometry.segment import MeshSettings
    from ngfsi_geometry.tube import BareTube

    sizes = MeshSettings(element="prism", axial_layers=8, vein_size=4e-3, curving_order=2)
    straight = BareTube(length=40e-3, lumen_diameter=8e-3, mesh=sizes)
    named = of_domain(Domain.build(straight))
    x, y, z = named.mesh.points.T
    radius = straight.length / QUARTER
    bent = np.stack([radius - (radius - x) * np.cos(z / radius), y, (radius - x) * np.sin(z / radius)], axis=1)
    named.mesh.points[:] = from_si(bent, "mm")
    write(named, path, "gmsh")
