"""How datagrams travel. All transports pass the same tests: tests/runtime/test_transports.py."""
