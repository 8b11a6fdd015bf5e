"""The page of stories: a template, its scripts, and the data that it shows, in one HTML file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from typing import Literal

from msgspec import to_builtins

from koord.api import verdict_forms
from koord.sim.page_files import filled
from koord.syntax.forms import Form, Natural
from koord.traces import story_form

#: The parts of the script, in their order.
_SCRIPTS = ("dom", "telling", "lanes", "turns", "why", "world", "texts", "overview", "main")


class ToldClaim(Form):
    """A claim with its rule, and the positions of the stories of its counterexamples."""

    claim: verdict_forms.Claim
    rule: str
    text: str
    stories: list[Natural]


class ToldReport(Form):
    """A whole verification: verdicts, what they rest on, and which stories tell of them."""

    about: str
    report: verdict_forms.Report
    claims: list[ToldClaim]
    texts: list[story_form.StoryText]


class Stories(Form):
    """What a page shows: stories, and the verification that they are of, if there is one."""

    format: Literal["koord-stories"]
    version: Literal[1]
    verifications: list[ToldReport]
    stories: list[story_form.Story]


def framed(page: str, title: str, height_px: int = 640) -> str:
    """A page within another one, as notebooks show results."""
    return (
        f'<iframe title="{escape(title)}" srcdoc="{escape(page)}" sandbox="allow-scripts" '
        f'style="width: 100%; height: {height_px}px; border: 0"></iframe>'
    )


def page_of(
    title: str, stories: Sequence[story_form.Story], verifications: Sequence[ToldReport] = ()
) -> str:
    """The page of some stories, and of the verifications that they are of; complete in itself."""
    shown = Stories("koord-stories", 1, list(verifications), list(stories))
    # In a script nothing ends it but `</`, and nothing else begins a comment but `<!`.
    data = json.dumps(to_builtins(shown), separators=(",", ":"))
    return filled("koord.api", title, _SCRIPTS, data.replace("<", "\\u003c"))
