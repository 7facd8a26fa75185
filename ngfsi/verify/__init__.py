"""Verification: benchmarks held against exact solutions and published values, and the page that shows it."""

from ngfsi.verify.engine import Benchmark, Levels, Reference, Result, Row, Setting, Signals, Values, VerificationError

__all__ = ["Benchmark", "Levels", "Reference", "Result", "Row", "Setting", "Signals", "Values", "VerificationError"]
