"""Closed outlines as splines, displacements along them, and their registration between images."""
