"""A lab's own hardware."""
