"""What an editor asks about a text: names and their places, types, completions, folds.

Everything here is a function of a text alone, and works on texts with mistakes: what cannot be read
is missing, and the rest is there. Read :mod:`koord.syntax.editing.model` first.
"""
