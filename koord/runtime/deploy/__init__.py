"""Compiled programs on the round-commit protocol: one robot a process."""
