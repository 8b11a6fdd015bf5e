"""Proofs for all rounds by constrained Horn clauses: reals and integers, without lemmas."""
