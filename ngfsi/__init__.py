"""High-order 3-D fluid-structure interaction for vascular and soft-tissue mechanics on NGSolve/Netgen."""

__version__ = "0.1.0"
