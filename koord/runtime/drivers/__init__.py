"""Drivers of vehicles: what is said to them, and what they sense."""
