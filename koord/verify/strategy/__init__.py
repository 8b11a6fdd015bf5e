"""Which engine is asked what, in which order, and how much it may do."""
