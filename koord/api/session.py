"""Sessions: a program that changes is verified again and again, as under an editor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from threading import Lock

from koord.api.cache import Cache
from koord.api.programs import Loadable
from koord.api.progress import Cancellation, Listener
from koord.api.robots import Robots, Seconds
from koord.api.verify import Engine, verify
from koord.api.verify_report import VerifyReport


class Session:
    """A verification session: what one call finds out is known to the next.

    The options are those of :func:`koord.verify`, the same for all calls. Threads may call it: a
    new call of :meth:`verify` ends one that is still going on, whose text is out of date, and
    which answers with what it knows by then.

    >>> session = koord.Session(robots=3)
    >>> session.verify(koord.Source("task.krd", text)).holds
    True
    """

    def __init__(
        self,
        *,
        robots: Robots = None,
        rounds: int = 20,
        delta_s: Seconds = None,
        engine: Engine | str = Engine.AUTO,
        timeout_s: float | None = None,
        property_timeout_s: float | None = None,
        jobs: int | None = None,
        seed: int = 0,
        cache: Cache | None = None,
    ) -> None:
        self._verify = partial(
            verify,
            robots=robots,
            rounds=rounds,
            delta_s=delta_s,
            engine=engine,
            timeout_s=timeout_s,
            property_timeout_s=property_timeout_s,
            jobs=jobs,
            seed=seed,
            cache=Cache() if cache is None else cache,
        )
        self._lock = Lock()
        self._going: Cancellation | None = None

    def verify(
        self,
        program: Loadable,
        *,
        properties: Sequence[str] = (),
        progress: Listener | None = None,
    ) -> VerifyReport:
        """Verify a program as it is now; of a call that was ended the report is ``interrupted``.

        ``properties`` are the names of those that are verified (all), ``progress`` hears what is
        being done. Raises what :func:`koord.verify` does.
        """
        with self._alone() as cancellation:
            return self._verify(
                program, properties=properties, progress=progress, cancellation=cancellation
            )

    def cancel(self) -> None:
        """End the call that is going on in another thread, if there is one."""
        with self._lock:
            if self._going is not None:
                self._going.cancel()

    @contextmanager
    def _alone(self) -> Iterator[Cancellation]:
        """Within the context no other call is wanted any more."""
        own = Cancellation()
        with self._lock:
            if self._going is not None:
                self._going.cancel()
            self._going = own
        try:
            yield own
        finally:
            with self._lock:
                if self._going is own:
                    self._going = None
