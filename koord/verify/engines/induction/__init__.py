"""Proofs by induction for a fixed number of robots."""
