"""Programs as TLA+ modules, for TLC: translated from the core program and the text of the rules."""
