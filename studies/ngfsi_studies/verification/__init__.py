"""Benchmarks of `ngfsi verify`: each module with a CASE is one, and exports LEVELS and REFERENCES too.

`tube`, `plane`, `turek_hron`, `solid` and `oscillation` compute, `radial` has independent solutions for rings,
`polynomial` hands exact profiles to NGSolve; they are no benchmarks.
"""

NOT_VERIFIED = (
    "Turek-Hron CFD3, FSI2 and FSI3 beyond one mesh and step each; flow that turns back through the outlet, whose "
    "profile is then that of developed flow; transient flow over walls of a law that is not linear in shear; "
    "tetrahedra; contact in 3-D with flow faster than at a Reynolds number of 1; viscosity of solids with flow, which "
    "tests of homogeneous states hold; growth of solids, which ngfsi does not have."
)
"""What no benchmark holds yet."""
