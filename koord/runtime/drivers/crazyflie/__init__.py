"""Crazyflies, by cflib."""
