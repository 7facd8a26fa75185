"""Linear solvers: static condensation, factorisations that outlive their matrix, and preconditioned GMRES."""
