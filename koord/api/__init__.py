"""The use-cases, one file each: typed requests in, typed results out.

Nothing here prints, reads arguments or exits, and nothing is global: several calls may run at a
time in threads. What is wrong with an input is a ``KoordError`` with its diagnostics.
"""
