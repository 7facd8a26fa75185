"""Benchmarks of `ngfsi verify`: each module with a CASE is one, and exports LEVELS and REFERENCES too.

`tube`, `plane`, `turek_hron`, `solid` and `oscillation` compute, `radial` has independent solutions for rings;
they are no benchmarks.
"""

NOT_VERIFIED = (
    "Obstacles in three dimensions (DFG 3D-1Z); vortices behind a rigid beam (Turek-Hron CFD3); Turek-Hron FSI2 and "
    "FSI3 beyond one mesh and step each; reversed flow through the outlet, where the term against backflow is that "
    "of no exact solution; tetrahedra; contact, viscosity and growth of solids, which ngfsi does not have."
)
"""What no benchmark holds yet."""
