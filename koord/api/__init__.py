"""The public API: one file per use-case, with typed requests and results.

Nothing here prints, reads arguments or exits, and nothing is global: several calls may run at a
time in threads. What is wrong with an input is a ``KoordError`` with its diagnostics.
"""
