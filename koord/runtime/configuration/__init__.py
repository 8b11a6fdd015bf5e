"""Configuration files: robots, positions and network, in YAML of two forms."""
