"""What may become of a verdict that is neither yes nor no."""

from __future__ import annotations

CHOICES = ("fail", "xfail", "warn")
