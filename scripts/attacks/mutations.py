"""Mutations of serialised messages and of the JSON in some of them, the same for the same seed."""

import random
import re
import struct
from collections.abc import Callable

ODD_NUMBERS = (0, 1, 2, 3, 255, 256, 32_767, 65_535, 65_536, 2**31 - 1, 2**31, 2**32 - 1)
ODD_VALUES = ("-1", "0", "1", "2", "65535", "65536", "4294967296", "1e308", "-1e308", "1e-320", "NaN", "Infinity",
              "null", "true", '"x"', "[]", "{}", "[[1]]", "0.5", "99999999999999999999999")
HEADER_BYTES = 200          # in which lengths, sizes and field tables lie
LONGEST_JUNK = 4096


class Mutator:
    """Makes one mutation after the other.

    Args:
        seed: of all choices.
        messages: real ones, serialised, of any type: what a message of one topic may be taken for on another.
    """

    def __init__(self, seed: int, messages: list[bytes]):
        self._random = random.Random(seed)
        self._messages = messages
        self._ways: list[Callable[[bytearray], bytes]] = [
            self._flip, self._flip_in_header, self._cut, self._lengthen, self._number, self._number, self._payload,
            self._junk, self._another, self._endian]

    def bytes_of(self, raw: bytes) -> bytes:
        """A mutation of a serialised message; never the message itself."""
        while (mutated := bytes(self._random.choice(self._ways)(bytearray(raw)))) == raw:
            pass
        return mutated

    def text_of(self, text: str) -> str:
        """A mutation of JSON: a number or a name replaced, a part cut out or doubled."""
        way = self._random.random()
        numbers = list(re.finditer(r"-?\d+(\.\d+)?([eE][-+]?\d+)?|\"\w*\"|true|false|null", text))
        if way < 0.7:
            found = self._random.choice(numbers)
            return text[:found.start()] + self._random.choice(ODD_VALUES) + text[found.end():]
        first, last = sorted(self._random.randrange(len(text) + 1) for _ in range(2))
        return text[:first] + text[last:] if way < 0.85 else text[:last] + text[first:]

    def _flip(self, raw: bytearray) -> bytearray:
        for _ in range(self._random.randint(1, 8)):
            raw[self._random.randrange(len(raw))] ^= 1 << self._random.randrange(8)
        return raw

    def _flip_in_header(self, raw: bytearray) -> bytearray:
        raw[self._random.randrange(min(len(raw), HEADER_BYTES))] ^= 1 << self._random.randrange(8)
        return raw

    def _cut(self, raw: bytearray) -> bytearray:
        """Cut off; not all of it: Fast DDS delivers nothing more of a publisher after a message of no bytes."""
        return raw[:self._random.randrange(1, len(raw))]

    def _lengthen(self, raw: bytearray) -> bytearray:
        return raw + self._random.randbytes(self._random.randint(1, 64))

    def _number(self, raw: bytearray) -> bytearray:
        """Another number where a length or a size may be."""
        at = 4 * self._random.randrange(min(len(raw), HEADER_BYTES) // 4)
        raw[at:at + 4] = struct.pack("<I", self._random.choice((*ODD_NUMBERS, self._random.randrange(2**32))))
        return raw

    def _payload(self, raw: bytearray) -> bytearray:
        at = self._random.randrange(len(raw))
        count = self._random.randrange(len(raw) - at) + 1
        raw[at:at + count] = self._random.randbytes(count)
        return raw

    def _junk(self, raw: bytearray) -> bytearray:
        return raw[:4] + self._random.randbytes(self._random.randrange(LONGEST_JUNK))

    def _another(self, _: bytearray) -> bytes:
        return self._random.choice(self._messages)

    def _endian(self, raw: bytearray) -> bytearray:
        raw[self._random.randrange(min(4, len(raw)))] ^= 1
        return raw
