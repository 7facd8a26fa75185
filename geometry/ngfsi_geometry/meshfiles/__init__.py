"""Meshes of other programs, read into points, blocks of cells and groups, or refused in one sentence."""

from ngfsi_geometry.meshfiles.raw import Block, Group, RawMesh
from ngfsi_geometry.meshfiles.read import read

__all__ = ["Block", "Group", "RawMesh", "read"]
