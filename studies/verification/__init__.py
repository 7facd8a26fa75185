"""Benchmarks of `ngfsi verify`: each module with a CASE is one, and exports LEVELS and REFERENCES too.

`tube` computes, `radial` has independent solutions for rings; they are no benchmarks.
"""
