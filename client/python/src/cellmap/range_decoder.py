"""Adaptive binary range decoding (FORMAT.md, "Range coding")."""

from .errors import corrupt

#: Models of an integer: zero, more[10], second[10].
INTEGER_MODELS = 21


class RangeDecoder:
    """A stream with its models, which are named by their numbers. About 0.5 us a bit."""

    def __init__(self, data: bytes, first: bytes) -> None:
        """``first``: the models' first probabilities in units of 1/256."""
        self.fast = [256 * p for p in first]
        self.slow = self.fast.copy()
        self.data, self.at = data, 4
        self.range, self.code = 2**32 - 1, int.from_bytes((data[:4] + bytes(4))[:4], "big")

    def bit(self, model: int) -> int:
        fast, slow = self.fast[model], self.slow[model]
        bound = (self.range >> 15) * ((fast + slow) >> 2)
        if self.code < bound:
            self.range = bound
            self.fast[model] = fast + ((65535 - fast) >> 4)
            self.slow[model] = slow + ((65535 - slow) >> 7)
            bit = 1
        else:
            self.code -= bound
            self.range -= bound
            self.fast[model] = fast - (fast >> 4)
            self.slow[model] = slow - (slow >> 7)
            bit = 0
        if self.range < 1 << 24:
            self._grow()
        return bit

    def plain(self, count: int) -> int:
        value = 0
        while count > 0:
            part = min(count, 16)
            count -= part
            self.range >>= part
            bits = min(self.code // self.range, (1 << part) - 1)
            self.code -= bits * self.range
            value = value << part | bits
            if self.range < 1 << 24:
                self._grow()
        return value

    def integer(self, models: int, digits: int) -> int:
        """``models`` is the first of INTEGER_MODELS."""
        if self.bit(models):
            return 0
        negative = self.plain(1)
        r = 0
        while r + 1 < digits and self.bit(models + 1 + min(r, 9)):
            r += 1
        magnitude = 1
        if r > 0:
            magnitude = 2 | self.bit(models + 11 + min(r, 9))
        if r > 1:
            magnitude = magnitude << (r - 1) | self.plain(r - 1)
        return -magnitude if negative else magnitude

    def finish(self) -> None:
        """Error("corrupt-data") where not all bytes were needed."""
        if self.at != len(self.data):
            raise corrupt("A layer of the coded CELL has bytes that say nothing.")

    def _grow(self) -> None:
        while self.range < 1 << 24:
            if self.at >= len(self.data):
                raise corrupt("A layer of the coded CELL ends too soon.")
            self.code = self.code << 8 | self.data[self.at]
            self.range <<= 8
            self.at += 1
