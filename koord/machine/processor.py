"""The processor of this machine, as Linux tells of it: what machine code is made for."""

from __future__ import annotations

from functools import cache
from pathlib import Path

#: What tells one kind of processor from another; the rest is of one core at one time.
_KINDS = frozenset(
    (
        *("vendor_id", "cpu family", "model", "model name", "stepping", "flags", "Features"),
        *("CPU implementer", "CPU architecture", "CPU variant", "CPU part", "CPU revision"),
    )
)

#: The first core stands within so many bytes.
_ENOUGH = 16_384

_PLACE = Path("/proc/cpuinfo")


@cache
def processor() -> dict[str, str]:
    """What is told of the first core, by name; nothing on other systems."""
    try:
        with _PLACE.open("rb") as file:
            first, _, _ = file.read(_ENOUGH).decode("utf-8", "replace").partition("\n\n")
    except OSError:
        return {}
    told = (line.partition(":") for line in first.splitlines())
    return {name.strip(): rest.strip() for name, _, rest in told if name.strip() in _KINDS}


def abilities() -> frozenset[str]:
    """The names of what it can do besides; none where that is not told."""
    told = processor()
    return frozenset((told.get("flags") or told.get("Features") or "").split())
