"""Compiled programs, and the round-commit protocol on which they run."""
