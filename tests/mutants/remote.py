"""Seeded mistakes in what starts, follows and gathers robots on their own computers."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

BY_SSH = "tests/runtime/platform/test_remote.py"

#: What trusts too much, stops who is to go on, or loses what was written.
REMOTE = (
    Mutant(
        "host keys need not be known",
        "runtime.remote.connecting._options",
        "there or _NOBODY",
        "there or None",
        (BY_SSH,),
    ),
    Mutant(
        "another version of koord will do",
        "runtime.remote.computer.Computer.open",
        "there != version",
        "there == ''",
        (BY_SSH,),
    ),
    Mutant(
        "keys can be read by others on the robot",
        "runtime.remote.computer.Computer._put",
        "await sftp.chmod(str(path), 0o600)",
        "await sftp.chmod(str(path), 0o644)",
        (BY_SSH,),
    ),
    Mutant(
        "nobody looks whether files have arrived whole",
        "runtime.remote.computer.Computer._put",
        "arrived != file.data",
        "not arrived",
        (BY_SSH,),
    ),
    Mutant(
        "a lost connection is the end of a robot",
        "runtime.remote.computer.Computer._is_lost",
        "self._close()",
        "self.given_up = why",
        (BY_SSH,),
    ),
    Mutant(
        "robots are told to stop at each look, which is at once",
        "runtime.remote.computer.Computer.follow",
        "self.stops and (not stopped)",
        "self.stops",
        (BY_SSH,),
    ),
    Mutant(
        "lines are told again after a lost connection",
        "runtime.remote.computer._Tail.read",
        "self._read += len(block)",
        "self._read = len(block)",
        (BY_SSH,),
    ),
    Mutant(
        "robots go on whose fleet is no majority any more",
        "api.remote._Remote._is_hopeless",
        "2 * len(lost) >= robots",
        "len(lost) > robots",
        (BY_SSH,),
    ),
    Mutant(
        "vehicles are armed without a yes",
        "api.remote._Remote._ask",
        "not (answer and found.is_good)",
        "not found.is_good",
        (BY_SSH,),
    ),
    Mutant(
        "vehicles are armed though something is bad",
        "api.remote._Remote._ask",
        "not (answer and found.is_good)",
        "not answer",
        (BY_SSH,),
    ),
    Mutant(
        "parts are removed though one was not fetched",
        "api.gathering.Gathering.traced",
        "merged.has_all_told and (not gathered.missing)",
        "True",
        (BY_SSH,),
    ),
    Mutant(
        "an earlier run is taken up",
        "api.remote._Remote._take_up",
        "max((run for each in runs.values() for run in each), default=None)",
        "min((run for each in runs.values() for run in each), default=None)",
        (BY_SSH,),
    ),
)
