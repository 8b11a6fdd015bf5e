"""Compiled programs in one process: all robots, one store, rounds one after the other."""
