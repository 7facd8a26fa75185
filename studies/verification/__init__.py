"""Benchmarks of `ngfsi verify`: each module with a CASE is one, and exports LEVELS and REFERENCES too.

`tube` and `solid` compute, `radial` has independent solutions for rings; they are no benchmarks.
"""

NOT_VERIFIED = (
    "Transient motion of blood and solids together against an exact solution; pressure waves along the vein; buckling; "
    "flow around obstacles; the published benchmarks of the field (Turek-Hron, DFG, Cook's membrane), which need a 2-D "
    "mode; reversed flow through the outlet, where the traction is that of no exact solution; tetrahedra."
)
"""What no benchmark holds yet."""
