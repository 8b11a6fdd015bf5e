"""Robots on vehicles: programs, motion and drivers. See specs/platforms/README.md."""
