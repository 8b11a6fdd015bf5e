"""Why a Crazyflie cannot be reached, and what would help."""

from __future__ import annotations

from koord.runtime.drivers.driver import DriverError


def unreachable(uri: str, why: str) -> DriverError:
    """What to tell people of a Crazyflie that does not answer, and why not."""
    where = f"the Crazyflie at `{uri}`"
    if "Dongle" in why or "radio with serial" in why:
        return DriverError(
            f"there is no Crazyradio for {where}",
            "plug it in; on Linux people need the right to use it (udev rules of Bitcraze)",
        )
    if "busy" in why:
        return DriverError(
            f"another process uses the Crazyradio of {where}",
            "each robot needs one of its own: radio://0/…, radio://1/…",
        )
    if "firmware" in why:
        return DriverError(f"{where}: {why}", "bring its firmware up to date")
    return DriverError(
        f"nothing is heard of {where}: {why}",
        "is it switched on? Are channel, rate and address those of `uri`?",
    )


def first_line(why: str) -> str:
    """What went wrong, without the traceback that cflib adds."""
    line = why.strip().split("\n")[0] if why.strip() else "it does not answer"
    return line.removeprefix("Couldn't load link driver: ")
