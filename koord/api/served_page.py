"""The page of a run, served while it goes on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from koord.api.progress import Listener, Progress
from koord.syntax.diagnostics import refusal
from koord.syntax.source import visible

if TYPE_CHECKING:
    from koord.sim.run_log import RunLog
    from koord.sim.viewing import Live

#: Where a page is served if nobody says: on this machine alone, at any port.
LIVE = ("127.0.0.1", 0)

#: How long browsers may take to fetch the end of a run.
PATIENCE_S = 5.0


class PageServed(Progress, frozen=True, kw_only=True):
    """Progress: the page of a run is served at this address."""

    address: str


@contextmanager
def served_page(
    recording: RunLog, tell: Listener, cure: str, address: tuple[str, int] = LIVE
) -> Iterator[Live]:
    """Serve the page of a run at an address and port (0: any). Raises KoordError with the cure."""
    from koord.sim.viewing import Live

    host, port = address
    try:
        server = Live(recording, port, host)
    except OSError as error:
        where = "on this machine" if address == LIVE else f"at {visible(f'{host}:{port}')}"
        story = f"the page cannot be served {where}: {error.strerror or error}"
        raise refusal("K933", "<live>", story, cure) from None
    with server as live:
        tell(PageServed(f"live: {live.address}", address=live.address))
        yield live
