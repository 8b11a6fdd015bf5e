"""Runs as data: recordings, traces, their JSON and ITF forms, and the rendering of their values."""
