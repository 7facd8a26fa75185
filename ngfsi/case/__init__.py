"""Case: everything a run depends on, as numbers and strings."""

from ngfsi.case.case import Case, Conditions, Discretisation, Loads, Materials, Output, Solver, TimeStepping
from ngfsi.conditions import Cuff

__all__ = ["Case", "Conditions", "Cuff", "Discretisation", "Loads", "Materials", "Output", "Solver", "TimeStepping"]
