"""Benchmarks of `ngfsi verify`: each module with a CASE is one, and exports LEVELS and REFERENCES too.

`tube`, `plane`, `turek_hron`, `solid` and `oscillation` compute, `radial` has independent solutions for rings,
`polynomial` hands exact profiles to NGSolve; they are no benchmarks.
"""

NOT_VERIFIED = (
    "Vortices behind a rigid beam (Turek-Hron CFD3) and the whole wave of DFG 2D-3, whose levels full are written but "
    "not computed yet; Turek-Hron FSI2 and FSI3 beyond one mesh and step each; reversed flow through the outlet, where "
    "the term against backflow is that of no exact solution; transient flow over walls of a law that is not linear in "
    "shear; tetrahedra; contact, viscosity and growth of solids, which ngfsi does not have."
)
"""What no benchmark holds yet."""
