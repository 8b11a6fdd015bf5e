"""The protocol on a simulated network, in virtual time, with every fault there is, by a seed."""
