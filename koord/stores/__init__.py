"""Stores of what was found out or made once: in memory, and in the folder of the user's cache."""
