"""Vehicle models, as arrays over all vehicles of a kind. Sources: specs/decisions/0015."""
