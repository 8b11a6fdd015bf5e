"""Parsing: tokens, lines, blocks, sections. Nothing here raises on any text."""
