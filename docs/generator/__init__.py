"""The program that makes the generated pages of the documentation site, and its links.

Nothing here needs mkdocs, except for `hook.py`, by which mkdocs asks for the pages.
"""
