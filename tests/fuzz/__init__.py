"""Fuzzing: what must hold of any bytes at all, and how inputs are varied."""
