"""What a page does with its data, in Python: the other way round from `koord.sim.packing`."""

from __future__ import annotations

import base64
import json
import re
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from koord.sim.packing import TILT, TURN


@dataclass(frozen=True, slots=True)
class Unpacked:
    """A pack: its document, and what its planes say."""

    document: dict[str, Any]
    times_s: NDArray[np.float64]
    poses: NDArray[np.float64]  #: times, robots, (x, y, z, heading)
    tilts: NDArray[np.float64]  #: times, robots that tilt, (roll, pitch)
    separations_m: NDArray[np.float64]
    deeds: NDArray[np.int16]  #: rounds, robots
    paths: list[tuple[float, int, NDArray[np.float64]]]


def data_of(page: bytes) -> bytes:
    """The pack in a page."""
    found = re.search(rb'id="data">([^<]*)<', page)
    assert found is not None
    return zlib.decompress(base64.b64decode(found[1]))


def unpacked(pack: bytes, header: dict[str, Any] | None = None) -> Unpacked:
    """The content of a pack; one that goes on needs the header of the first."""
    size = int.from_bytes(pack[:4], "little")
    document = json.loads(pack[4 : 4 + size])
    planes = {n: pack[4 + size + at :][:length] for n, at, length in document["planes"]}
    header = header or document["header"]
    robots, step, middle = len(header["robots"]), header["step"], np.array(header["middle"])
    times = np.frombuffer(planes["times"], "<u4")
    along = np.cumsum(
        np.cumsum(_joined(planes["poses"]).reshape(4, robots, len(times)), -1, dtype=np.int16),
        -1,
        dtype=np.int16,
    )
    whole = along.transpose(2, 1, 0).astype(np.float64)
    whole[..., :3] = middle + step * whole[..., :3]
    whole[..., 3] *= 2 * np.pi / TURN
    tilting = sum(robot["look"] == "drone" for robot in header["robots"])
    angles = _joined(planes["tilts"]).reshape(2, tilting, len(times))
    tilts = np.cumsum(angles, -1, dtype=np.int16).transpose(2, 1, 0).astype(np.float64)
    heads = np.frombuffer(planes["path_heads"], "<u4").reshape(3, -1).T
    points = np.cumsum(_joined(planes["path_points"]).reshape(3, -1), -1, dtype=np.int16)
    cuts = np.cumsum(heads[:, 2])[:-1]
    parts = np.split(middle + step * points.T, cuts) if len(heads) else []
    deeds = np.frombuffer(planes["deeds"], "<i2").reshape(robots, -1).T
    mm = np.frombuffer(planes["separations"], "<u2")
    return Unpacked(
        document,
        times / 1000,
        whole,
        tilts * (2 * np.pi / TILT),
        np.where(mm == 0xFFFF, np.nan, mm / 1000),
        deeds,
        [(ms / 1000, int(robot), part) for (ms, robot, _), part in zip(heads, parts, strict=True)],
    )


def _joined(plane: bytes) -> NDArray[np.int16]:
    low, high = np.frombuffer(plane, np.uint8).reshape(2, -1).astype(np.uint16)
    return (low | high << 8).view(np.int16)
