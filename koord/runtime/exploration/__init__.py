"""Exploration: bounded model checking of the protocol's implementation with a few robots."""
