"""Distances between points, segments and paths in space, for arrays of them.

Segments have shape ``(..., 3)`` for each end and broadcast against each other. A path is an array
of points, ``(k, 3)``; one of a single point stands for the robot that waits there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from koord.runtime.motion.arrays import Floats

_TINY = 1e-300


def as_path(points: Sequence[Sequence[float]] | Floats) -> Floats:
    """A path as an array of shape ``(k, 3)``; ``k`` may be 0."""
    return np.asarray(points, dtype=np.float64).reshape(-1, 3)


def point_segment(p: Floats, a: Floats, b: Floats) -> Floats:
    """The distances of points from segments, squared."""
    along = b - a
    length = np.einsum("...i,...i->...", along, along)
    share = np.einsum("...i,...i->...", p - a, along) / np.maximum(length, _TINY)
    gap = p - a - np.clip(share, 0.0, 1.0)[..., None] * along
    squares: Floats = np.einsum("...i,...i->...", gap, gap)
    return squares


def segment_segment(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    """The least distances between segments a–b and c–d, squared.

    It is reached at an end of one of them, or where the lines come nearest to each other if that is
    inside of both (Ericson, Real-Time Collision Detection, 5.1.9).
    """
    ends = np.minimum(
        np.minimum(point_segment(a, c, d), point_segment(b, c, d)),
        np.minimum(point_segment(c, a, b), point_segment(d, a, b)),
    )
    u, v, w = b - a, d - c, a - c
    uu = np.einsum("...i,...i->...", u, u)
    vv = np.einsum("...i,...i->...", v, v)
    uv = np.einsum("...i,...i->...", u, v)
    uw = np.einsum("...i,...i->...", u, w)
    vw = np.einsum("...i,...i->...", v, w)
    determinant = uu * vv - uv * uv
    skew = determinant > 1e-12 * uu * vv
    divisor = np.where(skew, determinant, 1.0)
    s, t = (uv * vw - vv * uw) / divisor, (uu * vw - uv * uw) / divisor
    inside = skew & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    gap = w + s[..., None] * u - t[..., None] * v
    return np.where(inside, np.minimum(ends, np.einsum("...i,...i->...", gap, gap)), ends)


def pieces(path: Floats) -> tuple[Floats, Floats]:
    """The segments of a path, by their starts and their ends."""
    return (path, path) if len(path) < 2 else (path[:-1], path[1:])


def path_distance(one: Floats, other: Floats) -> float:
    """The least distance between two paths; infinite if one has no point."""
    if not len(one) or not len(other):
        return np.inf
    (a, b), (c, d) = pieces(one), pieces(other)
    squares = segment_segment(a[:, None], b[:, None], c[None], d[None])
    return float(np.sqrt(squares.min()))


def point_path(p: Floats, path: Floats) -> float:
    """The distance of a point from a path; infinite if it has no point."""
    if not len(path):
        return np.inf
    return float(np.sqrt(point_segment(p[None], *pieces(path)).min()))


def length(path: Floats) -> float:
    """The length of a path, in metres."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def headings_of(attitudes: Floats) -> Floats:
    """The headings ``(n,)`` of unit quaternions ``(n, 4)``, w first, in rad from the x axis."""
    w, x, y, z = attitudes.T
    heading: Floats = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return heading


def wrapped(angle: Floats) -> Floats:
    """Wrap angles to [-π, π)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
