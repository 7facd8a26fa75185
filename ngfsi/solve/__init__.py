"""Unknowns, the coupled system, Newton's method, time schemes and the time loop."""
