"""Pictures of many runs, in files."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

from koord.api.files import write_atomically
from koord.api.results import ArgumentError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def check_drawable(path: str) -> None:
    """Raises ArgumentError before any work is done if no picture can come of it."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
    except ImportError:
        raise ArgumentError("plot", "needs matplotlib: pip install 'koord[plot]'") from None
    known = FigureCanvasAgg.get_supported_filetypes()
    if Path(path).suffix.removeprefix(".").lower() not in known:
        raise ArgumentError("plot", f"{path!r} is no picture; write times.svg or times.png")


def keep_figure(path: str, figure: Figure) -> None:
    """Write a picture, in the form that the file's name ends in. Raises KoordError."""
    form = Path(path).suffix.removeprefix(".").lower()
    # Without a date, so that equal results give equal files.
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(form)
    picture = io.BytesIO()
    figure.savefig(picture, format=form, metadata=undated)
    write_atomically(path, picture.getvalue())
