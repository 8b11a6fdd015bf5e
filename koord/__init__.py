"""Koord: programs for teams of robots, with a formal semantics that is run and verified.

Importing this package loads nothing else; the floors are described in ``ARCHITECTURE.md``.
"""

__version__ = "0.1.0"
