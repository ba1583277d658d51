"""Random changes to bytes, where no fuzzer that sees coverage is installed."""

from __future__ import annotations

import random
from collections.abc import Sequence

_EDGES = (b"\0", b"\xff", b"\x7f\xff", b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\xff" * 8, b"\n", b"9" * 40)


def mutated(data: bytes, others: Sequence[bytes], tokens: Sequence[bytes], chance: random.Random) -> bytes:
    """The bytes with one to eight changes, each of them small, or a piece of another input."""
    changed = bytearray(data)
    for _ in range(1 << chance.randrange(4)):
        place = chance.randrange(len(changed) + 1)
        match chance.randrange(7):
            case 0 if place < len(changed):
                changed[place] ^= 1 << chance.randrange(8)
            case 1:
                changed[place : place + 1] = bytes([chance.randrange(256)])
            case 2:
                del changed[place : place + chance.randrange(1, 33)]
            case 3:
                changed[place:place] = changed[place : place + chance.randrange(1, 65)] * chance.randrange(1, 5)
            case 4:
                changed[place:place] = chance.choice([*tokens, *_EDGES])
            case 5:
                edge = chance.choice(_EDGES)
                changed[place : place + len(edge)] = edge
            case _:
                other = chance.choice(others)
                start = chance.randrange(len(other) + 1)
                changed[place : place + chance.randrange(65)] = other[start : start + chance.randrange(65)]
    return bytes(changed)
