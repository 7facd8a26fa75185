"""Studies: designs, many cases on an executor, their table and report, surrogates."""

from ngfsi.study.engine import Outcome, Results, Study, failed, forget_failed, run_cases, run_study, workers

__all__ = ["Outcome", "Results", "Study", "failed", "forget_failed", "run_cases", "run_study", "workers"]
