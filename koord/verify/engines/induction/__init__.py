"""Inductive proofs for a fixed number of robots."""
