"""The language server: what :mod:`koord.api` answers about a text, over the protocol of editors."""
