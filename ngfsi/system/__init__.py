"""The coupled system: unknowns, forms, time schemes, residual and tangent."""
