"""The localiser of a device, as configurations state it: its own, or that of all.

(P-LOCATE-NAME)
"""

from __future__ import annotations

from typing import Any

from msgspec import Struct

from koord.runtime.configuration.forms import Device, Form
from koord.runtime.configuration.reading import Path

#: The localiser that is none: where a vehicle is, its driver says.
_OWN = "own"

_LIST = "name a `localiser`; `koord drivers` lists them"


class StatedLocaliser(Struct, frozen=True):
    """The name and the options of a device's localiser; None: its driver says where it is.

    ``flaws`` are what is wrong with that, each with its place and a cure.
    """

    name: str | None
    options: dict[str, Any]
    flaws: tuple[tuple[Path, str, str], ...]


def stated_localiser(form: Form, device: Device, path: Path, *, driven: bool) -> StatedLocaliser:
    """The localiser of a device, which stands at a path, and may have a driver."""
    name, flaws = device.localiser or form.localiser, []
    name = None if name == _OWN else name
    if device.localiser is not None and not driven:
        flaws.append(((*path, "localiser"), "nothing drives this vehicle", "name its `driver`"))
    elif name is None and device.localiser_options:
        flaws.append(((*path, "localiser_options"), "these are options of no localiser", _LIST))
    if form.localiser is None and form.localiser_options:
        flaws.append((("localiser_options",), "these are options of no localiser", _LIST))
    if name is None or not driven:
        return StatedLocaliser(None, {}, tuple(flaws))
    shared = form.localiser_options if name == form.localiser else {}
    return StatedLocaliser(name, {**shared, **device.localiser_options}, tuple(flaws))
