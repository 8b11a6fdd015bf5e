"""From text to tree: tokens, lines, blocks, sections. Nothing here raises on any text."""
