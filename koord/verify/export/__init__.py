"""Export of verification problems to other tools: AIGER, VMT, SMT-LIB, TLA+."""
