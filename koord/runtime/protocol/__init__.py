"""The round-commit protocol as a pure state machine: specs/protocol/README.md, in code.

``machine.step(setup, state, event) -> (state, effects)``. No socket, thread or clock in here.
"""
