"""The pages of diagnostics, from the stories of their codes."""

from __future__ import annotations

from docs.generator.markdown import code, fence, plain, table
from koord.syntax.catalogue import Story, entries

FOLDER = "reference/diagnostics"

#: The groups of codes, by their first digit: name of the page, title, what they are about.
GROUPS = {
    "1": ("text", "K1: texts", "What is wrong with the text: words, lines, brackets, blocks."),
    "2": ("meaning", "K2: names and types", "What does not fit: names, types, places, sizes."),
    "3": ("properties", "K3: properties and models", "Properties, contracts, summaries, models."),
    "4": ("warnings", "K4: warnings", "What is allowed, and seldom meant."),
    "9": ("runs", "K9: files and runs", "Files, traces, certificates, limits, runs, flags."),
}


def pages() -> dict[str, str]:
    """A page of each group of codes, and one that lists all codes."""
    stories = entries()
    made = {f"{FOLDER}/index.md": _index()}
    for digit, (name, title, about) in GROUPS.items():
        text = f"# {title}\n\n{about}\n"
        for story in stories.values():
            if story.code[1] == digit:
                text += "\n" + _story(story)
        made[f"{FOLDER}/{name}.md"] = text
    return made


def place(story: Story) -> str:
    """Where the story of a code is told, from the page that lists the codes."""
    return f"{GROUPS[story.code[1]][0]}.md#{story.code.lower()}"


def _index() -> str:
    rows = [
        (f"[{story.code}]({place(story)})", story.severity.value, plain(story.title))
        for story in entries().values()
    ]
    return (
        "# Diagnostics\n\nGenerated from the stories of the codes. `koord explain K204` prints "
        "the story of one.\n\n" + table(("code", "is", "what it is about"), rows)
    )


def _story(story: Story) -> str:
    text = f"## {story.code}: {plain(story.title)} {{#{story.code.lower()}}}\n\n"
    text += f"{code(story.severity.value)}\n\n{story.story}"
    if story.bad:
        verb = "refused" if story.severity.value == "error" else "warned of"
        text += f"\nThis is {verb}:\n\n{fence('koord', story.bad)}"
        text += f"\nThis is right:\n\n{fence('koord', story.good)}"
    return text
