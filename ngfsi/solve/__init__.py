"""Newton's method, states at t = 0, the time loop, equilibrium of plane sections, and ranks other than 0."""
