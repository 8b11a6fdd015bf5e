"""Exports of recorded runs to files other than the page: one module per format."""
