"""Deployment: compiled programs on the round-commit protocol, one process per robot."""
