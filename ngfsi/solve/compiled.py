"""Integrands compiled to machine code where a C++ compiler is at hand: residuals then cost half."""

from __future__ import annotations

import os
import shutil
import sys
from functools import cache
from pathlib import Path

import ngsolve as ng

DERIVATIVES = 1
"""Residual forms are differentiated once, by Newton's method; compiling second derivatives would double the time."""


@cache
def compiler_available() -> bool:
    """Whether NGSolve can compile here: tried once, since it needs a C++ compiler and the headers of Python."""
    beside = str(Path(sys.executable).parent)
    wrapper = shutil.which("ngscxx", path=beside)
    if wrapper is None or not any(map(shutil.which, ("c++", "g++"))):
        return False
    # NGSolve calls its wrapper by name, and the wrapper calls `python3`: both must be those of this interpreter
    if os.environ.get("PATH", "").split(os.pathsep)[0] != beside:
        os.environ["PATH"] = os.pathsep.join([beside, os.environ.get("PATH", "")])
    try:
        ng.sin(ng.x).Compile(realcompile=True, wait=True, maxderiv=0)
    except Exception:  # NGSolve raises its general exception with the compiler's exit
        return False
    return True


def compiled(integrand: ng.CoefficientFunction, *, native: bool) -> ng.CoefficientFunction:
    """Return the integrand as a linear sequence of steps, as machine code if `native` and a compiler is there."""
    if native and compiler_available():
        return integrand.Compile(realcompile=True, wait=True, maxderiv=DERIVATIVES)
    return integrand.Compile()
