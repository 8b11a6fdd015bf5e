"""Verification problems in the forms of other tools: AIGER, VMT, SMT-LIB, TLA+."""
