"""Provenance: which software, on what machine, from which commit a run was computed."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import ngfsi
from ngfsi import registry

PACKAGES = ("ngsolve", "netgen-mesher", "numpy", "pyvista", "vtk", "mkl")


def now() -> str:
    """Return the present time, ISO 8601 in UTC to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def versions() -> dict[str, str]:
    """Return the versions of this package, of Python, of the libraries that are installed and of plugins."""
    found = {"ngfsi": ngfsi.__version__, "python": platform.python_version(), **registry.versions()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # an optional library
            continue
    return found


def machine() -> dict[str, Any]:
    """Return what the computing time depends on."""
    return {"platform": platform.platform(), "processor": platform.machine(), "cpu_count": os.cpu_count()}


def commit() -> dict[str, Any] | None:
    """Return the Git commit of a clone and whether files differ from it; None when this is no clone."""
    root = Path(ngfsi.__file__).parents[1]
    top = _git(root, "rev-parse", "--show-toplevel")
    # an installed wheel may lie inside a foreign repository, whose commit says nothing about this code
    if top is None or Path(top).resolve() != root.resolve():
        return None
    identifier = _git(root, "rev-parse", "HEAD")
    if identifier is None:
        return None
    return {"id": identifier, "dirty": bool(_git(root, "status", "--porcelain"))}


def named_commit(manifest: Mapping[str, Any]) -> str:
    """Return the commit in the manifest of a run as the end of a sentence; empty if it names none."""
    found = manifest.get("commit")
    return f", commit {found['id'][:10]}{' with changes' if found['dirty'] else ''}" if found else ""


def _git(folder: Path, *arguments: str) -> str | None:
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *arguments], capture_output=True, text=True, timeout=10, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
