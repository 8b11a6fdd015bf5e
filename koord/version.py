"""The version of this package, which the documents that it writes state."""

__version__ = "0.1.0"
