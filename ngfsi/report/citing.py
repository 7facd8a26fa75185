"""What to cite for a stored run, and the commands that repeat it."""

from __future__ import annotations

import shlex

from ngfsi.case import Case
from ngfsi.materials import available_sets, read_set
from ngfsi.parallel.ranks import threads
from ngfsi.store.folder import CASE
from ngfsi.store.provenance import named_commit
from ngfsi.store.stored import StoredRun

SOFTWARE = (
    "J. Schöberl, C++11 implementation of finite elements in NGSolve, ASC Report 30/2014, TU Wien",
    "J. Schöberl, NETGEN: an advancing front 2D/3D-mesh generator based on abstract rules, Computing and Visualization "
    "in Science 1 (1997) 41",
)
MIXING = "H. F. Walker, P. Ni, Anderson acceleration for fixed-point iterations, SIAM J Numer Anal 49 (2011) 1715"
SCHWARZ = (
    "J. Schöberl, J. M. Melenk, C. Pechstein, S. Zaglmayr, Additive Schwarz preconditioning for p-version triangular "
    "and tetrahedral finite elements, IMA J Numer Anal 28 (2008) 1"
)
SOLVERS = {
    "pardiso": "O. Schenk, K. Gärtner, Solving unsymmetric sparse systems of linear equations with PARDISO, Future "
    "Generation Computer Systems 20 (2004) 475",
    "umfpack": "T. A. Davis, Algorithm 832: UMFPACK V4.3, ACM Trans Math Softw 30 (2004) 196",
    "p_multigrid": SCHWARZ,
    "fieldsplit": SCHWARZ,
}
PRESTRESS = (
    "S. Govindjee, P. A. Mihalic, Computational methods for inverse finite elastostatics, Comput Methods Appl Mech "
    "Engrg 136 (1996) 47"
)
ELASTIC_MESH = (
    "K. Stein, T. Tezduyar, R. Benney, Mesh moving techniques for fluid-structure interactions with large "
    "displacements, J Appl Mech 70 (2003) 58"
)


def citations(run: StoredRun) -> dict[str, list[str]]:
    """Return what a run rests on: heading -> references; of the methods and materials only those that it used."""
    versions = run.manifest.get("versions", {})
    case = run.case
    named = f"ngfsi {versions.get('ngfsi', '')}{named_commit(run.manifest)}, with NGSolve {versions.get('ngsolve', '')}"
    methods = [MIXING] if case.solver.linearise == "when slow" else []
    methods += [SOLVERS[name] for name in (run.manifest.get("linear_solver"),) if name in SOLVERS]
    methods += [PRESTRESS] if case.conditions.initial_state == "prestress" else []
    methods += [ELASTIC_MESH] if case.discretisation.mesh_motion == "elastic" else []
    return {"software": [named, *SOFTWARE], "methods": methods, "materials": _materials(case)}


def repeat_commands(run: StoredRun) -> list[str]:
    """Return the shell commands that compute a run again: code, packages, and the run with as many threads.

    With one thread the results are the same to the last bit on the same machine.
    """
    manifest = run.manifest
    versions = {name: version for name, version in manifest.get("versions", {}).items() if name not in _NOT_INSTALLED}
    plugins = [name for name in versions if name.endswith(".py")]
    commit = manifest.get("commit")
    commands = [f"git checkout {commit['id']}"] if commit else []
    if commit and commit["dirty"]:
        commands.append("# the files differed from that commit")
    if versions:
        commands.append(shlex.join(["pip", "install", *(f"{n}=={v}" for n, v in versions.items() if n not in plugins)]))
    environment = " ".join(f"{name}={count}" for name, count in threads(manifest.get("threads", 1)).items())
    solver = manifest.get("linear_solver", run.case.solver.linear)
    words = ["ngfsi", "run", str(run.path / CASE), "--output", f"{run.path}-again", "--set", f"solver.linear={solver}"]
    words += [word for plugin in plugins for word in ("--plugin", plugin)]
    return [*commands, f"{environment} {shlex.join(words)}"]


_NOT_INSTALLED = ("ngfsi", "python")


def _materials(case: Case) -> list[str]:
    """Return the sources of the parameter sets, which a label begins with, and of the laws."""
    found = []
    given = [(region, material) for region, material in case.materials if region != "membranes"]
    for region, material in [*given, *((one.on, one.material) for one in case.materials.membranes)]:
        if material is not None and (name := material.label.partition(" (")[0]) in available_sets():
            found.append(f"{region}: {read_set(name).source}")
        if source := getattr(material, "source", ""):
            found.append(f"{region}, law {material.law}: {source}")
    return found
