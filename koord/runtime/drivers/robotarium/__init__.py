"""Robots of the Robotarium, and of its simulator, by a process that owns the arena."""
