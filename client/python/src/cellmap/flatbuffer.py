"""Reads and writes the FlatBuffers of FORMAT.md without generated code.

The reader checks every offset before it follows it, so a file from anywhere may be read. Both sides name fields by
their ids, as FORMAT.md does. The writer has the layout of "How the library lays out a CELL".
"""

import struct
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from .errors import corrupt, unsupported

VERSION = 1
T = TypeVar("T")


class Buffer:
    """A whole file; ``name`` is what errors call it. Follows at most ``max_tables`` tables."""

    def __init__(self, data: bytes, identifier: bytes, name: str, max_bytes: int,
                 max_tables: Callable[[int], int] = lambda _: 64) -> None:
        if len(data) > max_bytes:
            raise corrupt(f"The {name} has {len(data)} bytes, at most {max_bytes} are allowed.")
        if len(data) < 8 or data[4:8] != identifier:
            raise corrupt(f"This is no {name}: it does not begin with the identifier {identifier.decode()}.")
        self.data, self.name, self.tables_left = bytes(data), name, max_tables(len(data))

    def root(self) -> "Table":
        table = Table(self, self.number("<I", 0))
        version = table.number(0, "<H")
        if version == 0:
            raise corrupt(f"The {self.name} does not say its version.")
        if version != VERSION:
            raise unsupported(f"The {self.name} is of version {version}; this package reads version {VERSION}.")
        return table

    def number(self, kind: str, at: int) -> int:
        if not 0 <= at <= len(self.data) - struct.calcsize(kind):
            raise corrupt(f"The {self.name} points outside of itself.")
        value: int = struct.unpack_from(kind, self.data, at)[0]
        return value

    def span(self, at: int, size: int) -> int:
        if not 0 <= at <= len(self.data) - size:
            raise corrupt(f"The {self.name} points outside of itself.")
        return at


class Table:
    """A table of a buffer. Absent numbers are ``default``; absent structs, strings and vectors None."""

    def __init__(self, buffer: Buffer, at: int) -> None:
        buffer.tables_left -= 1
        if buffer.tables_left < 0:
            raise corrupt(f"The {buffer.name} has more tables than its bytes can hold.")
        self.buffer, self.at = buffer, at
        self.vtable = at - buffer.number("<i", at)
        self.vtable_bytes = buffer.number("<H", self.vtable)
        self.bytes = buffer.number("<H", self.vtable + 2)
        if self.vtable_bytes < 4 or self.vtable_bytes % 2 != 0:
            raise corrupt(f"The {buffer.name} has a table without a sound directory.")
        buffer.span(self.vtable, self.vtable_bytes)
        buffer.span(at, self.bytes)

    def place(self, field: int, size: int) -> int | None:
        if 4 + 2 * field + 2 > self.vtable_bytes:
            return None
        offset = self.buffer.number("<H", self.vtable + 4 + 2 * field)
        if offset == 0:
            return None
        if offset < 4 or offset + size > self.bytes:
            raise corrupt(f"The {self.buffer.name} has a field outside of its table.")
        return self.buffer.span(self.at + offset, size)

    def number(self, field: int, kind: str, default: int = 0) -> int:
        at = self.place(field, struct.calcsize(kind))
        return default if at is None else self.buffer.number(kind, at)

    def double(self, field: int, default: float = 0.0) -> float:
        at = self.place(field, 8)
        if at is None:
            return default
        value: float = struct.unpack_from("<d", self.buffer.data, at)[0]
        return value

    def struct(self, field: int, size: int) -> bytes | None:
        at = self.place(field, size)
        return None if at is None else self.buffer.data[at:at + size]

    def target(self, field: int) -> int | None:
        at = self.place(field, 4)
        return None if at is None else at + self.buffer.number("<I", at)

    def table(self, field: int) -> "Table | None":
        at = self.target(field)
        return None if at is None else Table(self.buffer, at)

    def tables(self, field: int) -> "list[Table]":
        places = self.vector(field, "<u4")
        if places is None:
            return []
        begin = self.required(self.target(field)) + 4
        return [Table(self.buffer, begin + 4 * i + int(offset)) for i, offset in enumerate(places)]

    def vector(self, field: int, dtype: DTypeLike) -> NDArray[Any] | None:
        """A copy of a vector of numbers or structs."""
        at = self.target(field)
        if at is None:
            return None
        kind = np.dtype(dtype)
        count = self.buffer.number("<I", at)
        begin = self.buffer.span(at + 4, count * kind.itemsize)
        return np.frombuffer(self.buffer.data, kind, count, begin).copy()

    def vector_end(self, field: int) -> int:
        """Where a vector of bytes ends in the file."""
        at = self.required(self.target(field))
        return at + 4 + self.buffer.number("<I", at)

    def text(self, field: int) -> str | None:
        raw = self.vector(field, "u1")
        if raw is None:
            return None
        try:
            return raw.tobytes().decode()
        except UnicodeDecodeError:
            raise corrupt(f"The {self.buffer.name} has a text that is not UTF-8.") from None

    def required(self, value: T | None) -> T:
        if value is None:
            raise corrupt(f"The {self.buffer.name} lacks a required field.")
        return value


_SIZES = {"B": 1, "H": 2, "I": 4, "q": 8, "Q": 8, "d": 8}
Field = tuple[str, int | float | bytes]


class Builder:
    """Writes back to front; places are counted from the end. Each method returns the place of what it wrote."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []  # the last written first in the file
        self._size = 0
        self._min_align = 1
        self._vtables: dict[bytes, int] = {}

    def _push(self, packed: bytes) -> int:
        self._parts.append(packed)
        self._size += len(packed)
        return self._size

    def _align(self, alignment: int, upcoming: int) -> None:
        if upcoming == 0:  # an empty vector asks for no alignment of its elements
            return
        self._min_align = max(self._min_align, alignment)
        self._push(bytes(-(self._size + upcoming) % alignment))

    def _number(self, kind: str, value: int | float) -> int:
        self._align(_SIZES[kind], _SIZES[kind])
        return self._push(struct.pack("<" + kind, value))

    def _reference(self, target: int) -> int:
        self._align(4, 4)
        return self._number("I", self._size + 4 - target)

    def vector(self, packed: bytes, count: int, alignment: int) -> int:
        self._align(4, len(packed))
        self._align(alignment, len(packed))
        self._push(packed)
        return self._number("I", count)

    def text(self, text: str) -> int:
        packed = text.encode() + b"\0"
        self._align(4, len(packed))
        self._push(packed)
        return self._number("I", len(packed) - 1)

    def table(self, fields: dict[int, Field]) -> int:
        """Of ``id: (kind, value)``: kind "ref" (a place), "struct" (bytes aligned to 8) or a struct format."""
        start, places = self._size, {}
        for ident, (kind, value) in sorted(fields.items(), key=lambda f: (-_SIZES.get(f[1][0], 4), -f[0])):
            if kind == "struct":
                assert isinstance(value, bytes)
                self._align(8, len(value))
                places[ident] = self._push(value)
            elif kind == "ref":
                assert isinstance(value, int)
                places[ident] = self._reference(value)
            elif value != 0:
                assert not isinstance(value, bytes)
                places[ident] = self._number(kind, value)
        table = self._number("I", 0)
        soffset = len(self._parts) - 1
        count = max(places, default=-1) + 1
        entries = [table - places[i] if i in places else 0 for i in range(count)]
        vtable = struct.pack(f"<{2 + count}H", 4 + 2 * count, table - start, *entries)
        if vtable not in self._vtables:
            self._vtables[vtable] = self._push(vtable)
        self._parts[soffset] = struct.pack("<i", self._vtables[vtable] - table)
        return table

    def finish(self, root: int, identifier: bytes) -> bytes:
        self._align(self._min_align, 8)
        self._push(identifier)
        self._reference(root)
        return b"".join(reversed(self._parts))
