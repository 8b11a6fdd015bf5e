"""The tables of contents of a simulated Crazyflie: what can be logged, and its parameters.

Types, and how tables and values are laid out, are those of CRTP 4 and later (bitcraze/crazyflie-
firmware, `src/modules/interface/log.h`, `param.h`).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from enum import Enum

from msgspec import Struct


class Kind(Enum):
    """Types of values, with their format, their number in logs and that in parameters."""

    UINT8 = ("B", 1, 0x08)
    UINT16 = ("H", 2, 0x09)
    UINT32 = ("I", 3, 0x0A)
    FLOAT = ("f", 7, 0x06)
    HALF = ("e", 8, 0x05)

    @property
    def format(self) -> str:
        return "<" + self.value[0]

    @property
    def of_logs(self) -> int:
        return self.value[1]

    @property
    def of_parameters(self) -> int:
        return self.value[2]


BY_LOG_NUMBER = {kind.of_logs: kind for kind in Kind}


class Table:
    """Names with their types, in the order of their numbers."""

    def __init__(self, entries: Sequence[tuple[str, Kind]], type_byte: Callable[[Kind], int]):
        self.names = [name for name, _ in entries]
        self.kinds = dict(entries)
        self._items = [
            bytes([type_byte(kind)]) + name.replace(".", "\0").encode() + b"\0"
            for name, kind in entries
        ]
        self.crc = zlib.crc32(b"".join(self._items))

    def answer(self, request: bytes) -> bytes | None:
        """The answer to a question about the table itself, of version 2."""
        match request[0]:
            case 3:
                return struct.pack("<BHI", 3, len(self.names), self.crc) + b"\x10\x80"
            case 2:
                number: int = struct.unpack_from("<H", request, 1)[0]
                if number < len(self._items):
                    return request[:3] + self._items[number]
        return None


class Block(Struct):
    """What is logged together: variables by number, each as a type, and how often."""

    variables: list[tuple[int, Kind]]
    period_s: float | None = None  #: None: it was not started
    due_s: float = 0.0


class Logs:
    """The port of logs (5): its table, and the blocks that somebody has asked for."""

    #: `errno` of an unknown block, variable or command, and of a block that is too large.
    _ENOENT, _E2BIG, _ENOEXEC, _MOST = 2, 7, 8, 26

    def __init__(self, entries: Sequence[tuple[str, Kind]]) -> None:
        self.table = Table(entries, lambda kind: kind.of_logs)
        self.blocks: dict[int, Block] = {}

    def control(self, request: bytes, now_s: float) -> bytes:
        """Do what is asked for on channel 1; the answer ends with an `errno`."""
        command, number = request[0], request[1] if len(request) > 1 else 0
        error = 0
        match command:
            case 5:
                self.blocks = {}
            case 6:
                self.blocks[number] = Block([])
                error = self._append(number, request[2:])
            case 7 if number in self.blocks:
                error = self._append(number, request[2:])
            case 3 if number in self.blocks:
                self.blocks[number].period_s = request[2] / 100
                self.blocks[number].due_s = now_s
            case 4 if number in self.blocks:
                self.blocks[number].period_s = None
            case 2 if number in self.blocks:
                del self.blocks[number]
            case 2 | 3 | 4 | 7:
                error = self._ENOENT
            case _:
                error = self._ENOEXEC
        return bytes([command, number, error])

    def _append(self, number: int, items: bytes) -> int:
        block = self.blocks[number]
        for start in range(0, len(items) - 2, 3):
            kind, variable = struct.unpack_from("<BH", items, start)
            if variable >= len(self.table.names):
                return self._ENOENT
            block.variables.append((variable, BY_LOG_NUMBER[kind & 0xF]))
        size = sum(struct.calcsize(kind.format) for _, kind in block.variables)
        return self._E2BIG if size > self._MOST else 0

    def due(self, now_s: float, boot_ms: int, values: Mapping[str, float]) -> list[bytes]:
        """The blocks that are due by now, as data of channel 2."""
        found = []
        for number, block in self.blocks.items():
            if block.period_s is None or now_s < block.due_s:
                continue
            block.due_s = max(block.due_s + block.period_s, now_s - block.period_s)
            data = bytes([number]) + struct.pack("<I", boot_ms)[:3]
            for variable, kind in block.variables:
                value = values[self.table.names[variable]]
                whole = kind in (Kind.UINT8, Kind.UINT16, Kind.UINT32)
                data += struct.pack(kind.format, int(value) if whole else value)
            found.append(data)
        return found


class Parameters:
    """The port of parameters (2): its table and their values."""

    _ENOENT = 2

    def __init__(self, entries: Sequence[tuple[str, Kind, float]]) -> None:
        kinds = [(name, kind) for name, kind, _ in entries]
        self.table = Table(kinds, lambda kind: kind.of_parameters)
        self.values = {name: value for name, _, value in entries}

    def read(self, request: bytes) -> bytes:
        """Channel 1: the value by number."""
        (number,) = struct.unpack_from("<H", request)
        if number >= len(self.table.names):
            return request[:2] + bytes([self._ENOENT])
        return request[:2] + b"\0" + self._packed(self.table.names[number])

    def write(self, request: bytes) -> bytes:
        """Channel 2: set a value by number; the answer is the value."""
        (number,) = struct.unpack_from("<H", request)
        if number >= len(self.table.names):
            return request[:2] + bytes([self._ENOENT])
        name = self.table.names[number]
        self._set(name, request[2:])
        return request[:2] + self._packed(name)

    def write_by_name(self, request: bytes) -> bytes:
        """Channel 3, command 0: set a value by group and name."""
        group, name, rest = request[1:].split(b"\0", 2)
        full = f"{group.decode()}.{name.decode()}"
        if full not in self.values:
            return request + bytes([self._ENOENT])
        self._set(full, rest[1:])
        return request + b"\0"

    def _set(self, name: str, data: bytes) -> None:
        (self.values[name],) = struct.unpack_from(self.table.kinds[name].format, data)

    def _packed(self, name: str) -> bytes:
        kind = self.table.kinds[name]
        whole = kind is not Kind.FLOAT
        value = self.values[name]
        return struct.pack(kind.format, int(value) if whole else value)
