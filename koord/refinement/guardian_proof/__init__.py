"""The proof that the guardian keeps its invariants for all limits, times and facts.

It runs the guardian's own functions on symbols (``symbolic``), and is no model of them. See "Why
it is so" in specs/guardian/README.md.
"""
