"""Compiled programs and their round commit. Not in this version."""
