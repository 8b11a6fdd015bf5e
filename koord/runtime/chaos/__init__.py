"""Fault injection: the protocol on a simulated network, in virtual time, by a seed."""
