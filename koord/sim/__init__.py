"""The multi-robot simulator. Not in this version."""
