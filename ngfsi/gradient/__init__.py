"""Gradients: the derivative of what is measured of a whole run by what the case holds, by a discrete adjoint."""
