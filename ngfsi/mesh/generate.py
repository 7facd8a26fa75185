"""Get the mesh of a geometry without risk: in a child process with a time limit, tried in several ways, and cached.

Mesh generators can crash or hang for unlucky dimensions. The geometry therefore meshes in a child process,
which writes a file; when it dies or takes too long the geometry's next way is tried. A mesh that is kept is stored
under a hash of the geometry, of the Python files that define its class and those that it inherits from, and of the
NGSolve version.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import pickle
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import netgen.meshing as nm
import ngsolve
import numpy as np
from platformdirs import user_cache_dir

from ngfsi import process
from ngfsi.arrays import Array
from ngfsi.errors import MeshError
from ngfsi.mesh.curving import reference_shape
from ngfsi.units import in_unit

if TYPE_CHECKING:
    from ngfsi.mesh.geometry import Geometry

TIMEOUT = 60.0
"""Seconds after which one attempt of the mesher is given up."""

MESH_FILE, REPORT_FILE, REQUEST_FILE = "mesh.vol.gz", "report.json", "request.pickle"
RULE_ORDER = {**dict.fromkeys((ngsolve.TRIG, ngsolve.TET, ngsolve.PYRAMID), 6),
              **dict.fromkeys((ngsolve.QUAD, ngsolve.PRISM, ngsolve.HEX), 8)}  # fmt: skip


@dataclass(frozen=True)
class MeshReport:
    """How a mesh came about: the way that worked, what failed before, seconds spent, and whether it was cached."""

    way: str
    warnings: tuple[str, ...]
    seconds: float
    cached: bool = False


def generate(geometry: Geometry, *, timeout: float = TIMEOUT, cache: bool = True) -> tuple[Any, MeshReport]:
    """Return the straight Netgen mesh of a geometry (with names and CSG or OCC geometry) and how it came about.

    Geometries that put their elements together themselves say `guarded = False`: the other process and the cache would
    take longer than that.

    Args:
        timeout: seconds allowed for each attempt.
        cache: whether a mesh made earlier may be used and this one kept.

    Raises:
        MeshError: no way of meshing succeeded, or every mesh had inverted elements.
    """
    if type(geometry).__module__ == "__main__":
        raise MeshError(
            f"{type(geometry).__name__} is defined in the script that was started, where the mesher's own process "
            "cannot find it: move the class to a module"
        )
    if not getattr(geometry, "guarded", True):
        start = time.perf_counter()
        mesh = geometry.netgen_mesh()
        return mesh, MeshReport(geometry.mesh_attempts()[0], (), time.perf_counter() - start)
    key = content_key(geometry) if cache else None
    folder = cache_folder() / key if key else None
    if folder and (found := _read_cached(folder)):
        return found
    start = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="ngfsi-mesh-") as scratch:
        work = Path(scratch)
        way, failures = _first_success(geometry, work, timeout)
        report = MeshReport(way, failures, time.perf_counter() - start)
        mesh = load(work / MESH_FILE)
        if folder:
            _store(work / MESH_FILE, report, folder)
    return mesh, report


def _first_success(geometry: Geometry, work: Path, timeout: float) -> tuple[str, tuple[str, ...]]:
    """Try the ways of meshing in turn; return the one that worked and the failures before it."""
    failures: list[str] = []
    for attempt, way in enumerate(geometry.mesh_attempts()):
        failure = _run_child(geometry, attempt, work, timeout)
        if failure is None:
            return way, tuple(failures)
        failures.append(f"the mesher with {way} {failure}")
    raise MeshError(f"no mesh of {type(geometry).__name__} could be made in {len(failures)} attempts; {failures[0]}")


def _run_child(geometry: Geometry, attempt: int, work: Path, timeout: float) -> str | None:
    """Mesh in a child process into `work`; return None, or how it failed."""
    (work / REQUEST_FILE).write_bytes(pickle.dumps((geometry, attempt)))
    try:
        child = process.call("ngfsi.mesh.generate:main", work, timeout=timeout)
    except subprocess.TimeoutExpired:
        return f"took longer than {timeout:g} s"
    if (work / MESH_FILE).exists():
        return None
    if child.returncode < 0:
        return f"crashed with signal {-child.returncode}"
    return f"failed: {process.last_line(child.stderr, 'no message')}"


def main(folder: str) -> None:
    """Child process: mesh the requested geometry, check the curved mesh as it will be loaded, keep the straight one."""
    work = Path(folder)
    geometry, attempt = pickle.loads((work / REQUEST_FILE).read_bytes())
    unchecked = work / f"unchecked-{MESH_FILE}"
    with quiet():
        geometry.netgen_mesh(attempt).Save(str(unchecked))
        mesh = ngsolve.Mesh(load(unchecked))
        check_shape(mesh, shape_of(mesh, geometry))
    unchecked.rename(work / MESH_FILE)


def shape_of(mesh: Any, geometry: Geometry) -> Any:
    """Return the displacement from a geometry's straight mesh to its reference shape."""
    names = set(mesh.GetBoundaries())
    boundaries = [name for name in (*geometry.boundary_names, *geometry.internal_names) if name in names]
    return reference_shape(mesh, boundaries, geometry.curving_order, geometry.shape_map())


def load(path: Path) -> Any:
    """Read a Netgen mesh; the file also holds the geometry its elements are curved on."""
    mesh = nm.Mesh()
    with quiet():
        mesh.Load(str(path))
    return mesh


@contextmanager
def quiet() -> Iterator[None]:
    """Silence Netgen's messages inside the block and leave the level as it was."""
    level = ngsolve.ngsglobals.msg_level
    ngsolve.ngsglobals.msg_level = 0
    try:
        yield
    finally:
        ngsolve.ngsglobals.msg_level = level


def jacobian_ratios(mesh: Any, shape: Any) -> Array:
    """Return for each element the smallest over the largest Jacobian determinant of its map.

    1 is an affine element, 0 or less one that is inverted somewhere. `shape`: displacement of the straight mesh, a
    grid function; the mesh itself must have no deformation set.
    """
    rules = {element: ngsolve.IntegrationRule(element, order) for element, order in RULE_ORDER.items()}
    determinant = ngsolve.Det(ngsolve.specialcf.JacobianMatrix(mesh.dim))
    determinant = determinant * ngsolve.Det(ngsolve.Id(mesh.dim) + ngsolve.Grad(shape))
    kinds = [element.type for element in mesh.Elements(ngsolve.VOL)]
    values = determinant(mesh.MapToAllElements(rules, ngsolve.VOL)).ravel()
    ends = np.cumsum([len(rules[kind].weights) for kind in kinds])
    ratios = np.empty(mesh.ne)
    for number, part in enumerate(np.split(values, ends[:-1])):
        signed = part if part.sum() > 0 else -part
        ratios[number] = signed.min() / signed.max()
    return ratios


def check_shape(mesh: Any, shape: Any) -> float:
    """Return the worst Jacobian ratio of the elements; raise MeshError when a curved element is inverted somewhere."""
    ratios = jacobian_ratios(mesh, shape)
    bad = np.flatnonzero(~(ratios > 0))
    if len(bad):
        worst = mesh[ngsolve.ElementId(ngsolve.VOL, int(np.argmin(ratios)))]
        place = in_unit(np.mean([mesh[v].point for v in worst.vertices], axis=0), "mm", ".3g")
        raise MeshError(
            f"{len(bad)} of {mesh.ne} curved elements are inverted, the worst in region '{worst.mat}' near "
            f"{place}: make elements along curved surfaces shorter or layers thicker"
        )
    return float(ratios.min())


def cache_folder() -> Path:
    """Return the folder of cached meshes: $NGFSI_CACHE or the user's cache folder."""
    return Path(os.environ.get("NGFSI_CACHE") or user_cache_dir("ngfsi")) / "meshes"


def content_key(geometry: Geometry) -> str | None:
    """Return the hash under which the mesh is cached, or None when the source of the geometry cannot be read."""
    cls = type(geometry)
    try:
        sources = [path.read_bytes() for path in sorted(_sources(cls))]
    except (OSError, TypeError):
        return None
    content = f"{cls.__module__}:{cls.__qualname__} {geometry!r} ngsolve {ngsolve.__version__}"
    return hashlib.sha256(b"\0".join([content.encode(), *sources])).hexdigest()[:32]


def _sources(cls: type) -> set[Path]:
    """Return the Python files of a class and the geometries it inherits from: all of a package, or a single file."""
    found: set[Path] = set()
    for base in cls.__mro__:
        if hasattr(base, "netgen_mesh"):
            file = Path(inspect.getfile(base))
            found |= set(file.parent.glob("*.py")) if "." in base.__module__ else {file}
    return found


def _read_cached(folder: Path) -> tuple[Any, MeshReport] | None:
    """Return the cached mesh and its report if both are there and whole."""
    try:
        data = json.loads((folder / REPORT_FILE).read_text(encoding="utf-8"))
        if data.pop("sha256") != _digest(folder / MESH_FILE):
            return None
        report = MeshReport(**(data | {"warnings": tuple(data["warnings"]), "cached": True}))
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return load(folder / MESH_FILE), report


def _store(mesh_file: Path, report: MeshReport, folder: Path) -> None:
    """Put mesh and report into the cache in one step; a cache that cannot be written is not needed."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".new-", dir=folder.parent) as new:
            entry = Path(new) / "entry"
            entry.mkdir()
            shutil.copyfile(mesh_file, entry / MESH_FILE)
            text = json.dumps(asdict(report) | {"sha256": _digest(mesh_file)})
            (entry / REPORT_FILE).write_text(text, encoding="utf-8")
            if folder.exists():  # its content is not whole, or it would have been used
                folder.rename(Path(new) / "old")
            entry.rename(folder)
    except OSError:
        return


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
