"""The words of the language, by what they are: one list for lexer, editors and highlighters.

``editors/`` and the Pygments lexer are made of it; ``tests/syntax/test_vocabulary.py`` holds it
against the grammar, the types and the library.
"""

from __future__ import annotations


def words(text: str) -> frozenset[str]:
    """The words of a text, as a set."""
    return frozenset(text.split())


#: Words that begin a section of a program, or a part of an event.
SECTIONS = words(
    """agent allread allwrite assume def eff enum eventually init invariant local param pre urgent
    using"""
)

#: Words of statements.
STATEMENTS = words("atomic break elif else for if pass repeat return stop trystop")

#: Operators, and words that bind names, which are words.
OPERATORS = words("and exists forall implies in leadsto not or")

#: Truth values.
CONSTANTS = words("false False true True")

#: Words that no program may use as names.
KEYWORDS = SECTIONS | STATEMENTS | OPERATORS | CONSTANTS

#: Words that are keywords only where their construct is, and names elsewhere.
CONTEXTUAL = words(
    """actuators adt at contract ensures environment extern fresh fun module requires round
    sensors"""
)

#: Of these, what is a keyword before a colon.
HEADS = words("actuators ensures environment requires sensors")

#: Names that the language gives a meaning without a declaration.
OWN_NAMES = words("Nsys delta numAgents pi pid result stopped")

#: The names of types that every program has, and of those that take types as arguments.
TYPES = words("Point bool boolean float int pos stream string")
GENERIC_TYPES = words("List Map Queue Set")

#: Functions of the language, of which programs declare none, by what they are written like.
FUNCTIONS = words(
    """abs add all any append assign choose clamp contains float keys len length max min pop pos
    ran remove toList"""
)

#: Signs, the longer ones first.
SIGNS = (
    *("<<", "->", "++", "--", "==", "!=", "<=", ">=", "&&", "||"),
    *("≠", "≤", "≥", "+", "-", "*", "/", "%", "<", ">", "=", "!", "@", "'"),
)
