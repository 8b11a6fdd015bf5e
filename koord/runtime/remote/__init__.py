"""Robots' own computers, over SSH. See specs/platforms/README.md (P-SSH)."""
