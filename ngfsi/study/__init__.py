"""Studies: designs, many cases on an executor, their table and report, surrogates."""

from ngfsi.study.engine import Outcome, Results, Study, forget_failed, run_cases, run_study, workers
from ngfsi.study.page import write_page

__all__ = ["Outcome", "Results", "Study", "forget_failed", "run_cases", "run_study", "workers", "write_page"]
