"""The proof that the round-commit protocol is safe for every number of robots, rounds and epochs.

See "For every number of robots" in specs/protocol/README.md.
"""
