"""One run, from a case to a folder of results: computed, shown, stopped and resumed."""

from ngfsi.run.computation import completed, resume, run

__all__ = ["completed", "resume", "run"]
