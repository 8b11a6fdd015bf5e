"""Migration of programs: from forms that the language had before to those of today."""

from __future__ import annotations

from koord.api.programs import Text, source_of
from koord.api.results import Result, diagnostic_form, html_table
from koord.syntax.diagnostics import Diagnostic, Severity
from koord.syntax.edits import edited
from koord.syntax.load import load
from koord.syntax.source import Source

#: What an edit brings to light may have edits itself, as a line that could not be read before.
_MOST_PASSES = 20


#: Functions that nobody declares: their edits are declarations, which say more than the text did.
_STUBBED = "K202"


class Migration(Result, frozen=True):
    """A program in today's forms.

    ``text`` is the whole of it, with its comments and its layout. ``steps`` are what was done, each
    with its place in the text as it was then, what it is, and its edits; ``left`` what is told of
    the text that came out: errors are what nobody but a person can mend.
    """

    source: Source
    text: str
    steps: tuple[Diagnostic, ...]
    left: tuple[Diagnostic, ...]

    @property
    def changed(self) -> bool:
        """True if the text is another one than before."""
        return self.text != self.source.text

    @property
    def migrated(self) -> Source:
        """The text that came out, by the name of the one that went in."""
        return Source(self.source.name, self.text)

    @property
    def errors(self) -> tuple[Diagnostic, ...]:
        """What the text that came out is refused for."""
        return tuple(d for d in self.left if d.severity is Severity.ERROR)

    def to_dict(self) -> dict[str, object]:
        """The migration as plain data, as ``koord migrate --json`` prints it of each file."""
        from msgspec import to_builtins

        from koord.api import forms

        made = forms.MigratedFile(
            self.source.name,
            self.changed,
            self.text,
            [diagnostic_form(step) for step in self.steps],
            [diagnostic_form(one) for one in self.left],
        )
        found: dict[str, object] = to_builtins(made)
        return found

    def __repr__(self) -> str:
        said = f"{len(self.steps)} old forms, {len(self.errors)} errors left"
        lines = [f"{step.span}: {step.message}: {step.hint}" for step in self.steps]
        return "\n".join([f"<Migration {self.source.name}: {said}>", *lines])

    def _repr_html_(self) -> str:
        rows = [(step.span, step.message, step.hint) for step in self.steps]
        return html_table(
            f"{self.source.name}: {len(rows)} old forms", ("place", "was", "now"), rows
        )


def migrate(text: Text, *, stub: bool = False) -> Migration:
    r"""Bring a program over to today's forms, with the same meaning. [OLD-FORM]

    Comments, layout and everything else stay; a program in today's forms stays as it is. With
    ``stub`` functions that it calls and nobody declares are declared at its end, as external ones
    with any answer. Raises :class:`koord.KoordError` only where a file cannot be read.

    >>> koord.migrate(koord.Source("a.krd", "local\n int n = numBots\n")).text
    'local:\n int n = numAgents\n'
    """
    source = source_of(text)
    now, steps = source, list[Diagnostic]()
    left = load(now).diagnostics
    for _ in range(_MOST_PASSES):
        found = [one for one in left if one.edits and (stub or one.code != _STUBBED)]
        after = edited(now, (edit for one in found for edit in one.edits))
        if after == now.text:
            break
        steps += found
        now = Source(source.name, after)
        left = load(now).diagnostics
    return Migration(source, now.text, tuple(steps), left)
