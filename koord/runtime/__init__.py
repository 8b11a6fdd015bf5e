"""Compiled programs and their round commit."""
