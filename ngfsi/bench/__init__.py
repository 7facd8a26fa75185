"""Benchmarks of speed: whole runs by turns."""
