"""Proofs for every number of robots. [T-EVERY-N]"""
