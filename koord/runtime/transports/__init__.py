"""Transports of datagrams. All pass the same tests: tests/runtime/test_transports.py."""
