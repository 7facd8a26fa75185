"""Meshes: generated in a guarded process, curved, and with checked names."""
