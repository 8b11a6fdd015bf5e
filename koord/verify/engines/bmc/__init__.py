"""Bounded model checking: rounds unrolled on one incremental solver."""
