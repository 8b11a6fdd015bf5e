"""The request for a deployment, as plain data, and whether its files can be written."""

from __future__ import annotations

from msgspec import Struct

from koord.api.files import check_writable, same_file
from koord.api.results import ArgumentError
from koord.runtime.motion.libraries import require

#: Why a robot that runs by itself is not restarted.
NOT_RESTARTED = (
    "this is for robots that are all processes on this machine; what starts one restarts it"
)

#: Why a robot that runs by itself shares no process.
NOT_SHARED = "this is for robots that are all on this machine"

#: Why a recording and a trace have names of their own.
NOT_TWICE = "this is the file of the trace as well: say another one"


class DeployRequest(Struct, frozen=True):
    """The request for a deployment. ``pid`` None: all robots, as processes on this machine."""

    pid: int | None = None
    rounds: int | None = None
    as_fast_as_possible: bool = False
    run: str | None = None
    state: str | None = None
    fresh: bool = False
    record: str | None = None
    restart: bool = False
    trace: str | None = None
    dry_run: bool = False
    allow_models: tuple[str, ...] = ()
    arm: bool = False
    preflight: bool = False
    rests_on: str | None = None
    live: tuple[str, int] | None = None  #: address and port
    loss: float = 0.0  #: the share of the datagrams that are lost on purpose
    processes: int | None = None  #: so many share the robots; None: each has its own


def check_outputs(request: DeployRequest) -> None:
    """Check that trace and recording can be written. Raises KoordError and ArgumentError."""
    if request.trace is not None:
        check_writable(request.trace)
    if request.record is not None:
        check_writable(request.record)
        if request.trace is not None and same_file(request.record, request.trace):
            raise ArgumentError("record", NOT_TWICE)
        require(("mcap",), "record")
