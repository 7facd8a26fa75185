"""Laws of solids, one per file: the stored energy and, where they exist, the initial moduli."""
