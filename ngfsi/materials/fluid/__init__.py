"""Laws of fluids, one per file."""
