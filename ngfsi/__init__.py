"""High-order 3-D fluid-structure interaction for vascular and soft-tissue mechanics on NGSolve/Netgen."""

__version__ = "0.1.0"


def __getattr__(name: str) -> object:
    """Load `open_run` when it is asked for: reading a run takes libraries that importing the package need not."""
    if name == "open_run":
        from ngfsi.output.stored import open_run

        return open_run
    raise AttributeError(f"module 'ngfsi' has no attribute '{name}'")
