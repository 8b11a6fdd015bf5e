"""Refinement: runs of compiled programs, checked against the reference semantics."""
