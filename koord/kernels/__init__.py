"""Transition kernels: one robot's turns as machine code on packed states."""
