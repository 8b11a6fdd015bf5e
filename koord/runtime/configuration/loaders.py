"""The choice of a YAML loader: libyaml's where its answers are those of PyYAML's own.

The two take some texts differently: tabs, tags, block scalars, a ``?`` inside of brackets, the last
line without a line end, an empty value before a comma. Such texts, which are rare, are left to the
loader in pure Python, which is twenty times as slow.
"""

from __future__ import annotations

import re

import yaml

#: Printable characters without those that only one of the loaders takes for a space or a line end.
_PRINTABLE = re.compile(
    r"[\n -~\xa1-\u2027\u202a-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]*\n"
)

#: Outside of comments: the beginnings of directives, tags, anchors, aliases, block scalars and
#: explicit keys; and an empty value inside of brackets, which they place differently.
_ODD = re.compile(r"^(?! *#).*[!%&*>?|]|:(?: *(?:#.*)?\n)* *[,}\]]", re.MULTILINE)


def quick_loader(text: str) -> type[yaml.CSafeLoader] | None:
    """The loader of libyaml; None if there is no libyaml, or it might see a text differently."""
    if not yaml.__with_libyaml__ or _PRINTABLE.fullmatch(text) is None or _ODD.search(text):
        return None
    return yaml.CSafeLoader
