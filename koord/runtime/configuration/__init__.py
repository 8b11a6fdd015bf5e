"""Configuration files: which robots there are, where, and how they talk. YAML in two forms."""
