"""High-order 3-D fluid-structure interaction for vascular and soft-tissue mechanics on NGSolve/Netgen."""

import os

__version__ = "1.0.0"

# NGSolve's own threads do the work. Those of its BLAS, for the small matrices of single elements, and those of MKL,
# which by default go on spinning for 0.2 s after each call, take the processors from them: a run of the calf with two
# threads took 60 s instead of 31 s. Both libraries read this when they are loaded.
for _name, _value in {"OPENBLAS_NUM_THREADS": "1", "KMP_BLOCKTIME": "0"}.items():
    os.environ.setdefault(_name, _value)


def __getattr__(name: str) -> object:
    """Load `open_run` when it is asked for: reading a run takes libraries that importing the package need not."""
    if name == "open_run":
        from ngfsi.store.stored import open_run

        return open_run
    raise AttributeError(f"module 'ngfsi' has no attribute '{name}'")
