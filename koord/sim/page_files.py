"""Pages of koord: templates, styles and scripts, put together to one file that loads nothing."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape
from importlib.resources import files


def filled(room: str, title: str, scripts: Sequence[str], data: str) -> str:
    """Fill in the template of a room, which has its page in a folder ``page``.

    What every page has (``theme.css``, ``dom.js``) is that of this room.
    """
    common, own = files("koord.sim") / "page", files(room) / "page"

    def script(name: str) -> str:
        here = own / f"{name}.js"
        return (here if here.is_file() else common / f"{name}.js").read_text("utf-8")

    parts = {
        "title": escape(title),
        "style": (common / "theme.css").read_text("utf-8") + (own / "style.css").read_text("utf-8"),
        "script": '"use strict";\n' + "\n".join(map(script, scripts)),
        "data": data,
    }
    template = (own / "page.html").read_text("utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], template)
