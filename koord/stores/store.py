"""Stores of data: by keys, each of so many bytes."""

from __future__ import annotations

from collections import OrderedDict
from threading import Lock
from typing import Protocol

#: So much is kept in memory, in bytes, where nothing else is said.
MEMORY_LIMIT = 64 * 2**20


class Store(Protocol):
    """A store: what it has lost, or never had, is found out anew."""

    def get(self, key: str) -> bytes | None:
        """The data of a key, if there are any."""

    def put(self, key: str, data: bytes) -> bool:
        """Keep data, in the place of those that the key had; return whether that can be."""

    def drop(self, key: str) -> None:
        """Forget the data of a key, which turned out to be damaged."""


class MemoryStore:
    """A store in memory, which threads may share; what was used last is kept longest."""

    def __init__(self, limit: int = MEMORY_LIMIT) -> None:
        self._limit, self._size, self._lock = limit, 0, Lock()
        self._data: OrderedDict[str, bytes] = OrderedDict()

    def get(self, key: str) -> bytes | None:
        with self._lock:
            data = self._data.get(key)
            if data is not None:
                self._data.move_to_end(key)
            return data

    def put(self, key: str, data: bytes) -> bool:
        with self._lock:
            self._forget(key)
            self._data[key] = data
            self._size += len(data)
            while self._size > self._limit:
                self._forget(next(iter(self._data)))
            return key in self._data

    def drop(self, key: str) -> None:
        with self._lock:
            self._forget(key)

    def _forget(self, key: str) -> None:
        self._size -= len(self._data.pop(key, b""))


class LayeredStore:
    """A store in memory before another one, which lasts longer and is slower."""

    def __init__(self, memory: MemoryStore, behind: Store) -> None:
        self._memory, self._behind = memory, behind

    def get(self, key: str) -> bytes | None:
        data = self._memory.get(key)
        if data is None:
            data = self._behind.get(key)
            if data is not None:
                self._memory.put(key, data)
        return data

    def put(self, key: str, data: bytes) -> bool:
        self._memory.put(key, data)
        return self._behind.put(key, data)

    def drop(self, key: str) -> None:
        self._memory.drop(key)
        self._behind.drop(key)
