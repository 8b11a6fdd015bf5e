"""Liveness: fair cycles by search, and on circuits by counting and by loops of bounded length."""
