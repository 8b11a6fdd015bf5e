"""Fleets as columns of state, whose turns are made by machine code where it is sure of them."""
