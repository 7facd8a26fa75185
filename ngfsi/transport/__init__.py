"""Scalars that the blood carries: what they are, and the scheme by which they go with it."""
