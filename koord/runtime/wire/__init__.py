"""The wire format: typed, versioned, authenticated datagrams of at most 1,400 bytes.

What arrives is untrusted until its authentication is checked, is never evaluated, and never raises:
it is a message or one of the reasons of :class:`koord.runtime.wire.frames.Drop`, which are counted.
"""
