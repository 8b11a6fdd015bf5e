"""Runs as data: recordings, traces, their JSON and ITF forms, and how their values are shown."""
