"""Models of vehicles, arrays over all vehicles of a kind. Sources: specs/decisions/0015."""
