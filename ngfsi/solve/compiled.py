"""Integrands compiled to machine code where a C++ compiler is at hand: tissue residuals then cost a seventh."""

from __future__ import annotations

import os
import shutil
import sys
from functools import cache
from pathlib import Path

from ngsolve import CoefficientFunction

DERIVATIVES = 1
"""Residual forms are differentiated once, by Newton's method; compiling second derivatives would double the time."""


@cache
def compiler_available() -> bool:
    """Whether NGSolve's compiler wrapper and a C++ compiler are there; puts the wrapper's folder on the path."""
    beside = str(Path(sys.executable).parent)
    path = os.environ.get("PATH", "")
    if shutil.which("ngscxx") is None and shutil.which("ngscxx", path=beside):
        os.environ["PATH"] = os.pathsep.join([path, beside])
    return shutil.which("ngscxx") is not None and any(map(shutil.which, ("g++", "c++", "clang++")))


def compiled(integrand: CoefficientFunction, *, native: bool) -> CoefficientFunction:
    """Return the integrand as a linear sequence of steps, as machine code if `native` and a compiler is there."""
    if native and compiler_available():
        return integrand.Compile(realcompile=True, wait=True, maxderiv=DERIVATIVES)
    return integrand.Compile()
