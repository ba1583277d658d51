"""CRC-32/MPEG-2, the check of KVH's and Sensonor's frames, for one frame and for many at once.

    polynomial 04C11DB7h | register preset to FFFFFFFFh | bits in the order of the wire | result as it is

Source: the catalogue of parametrised CRC algorithms (check value 0376E6E7h for "123456789"); ROS driver KVH1750Test.cpp
(a frame with its CRC).

One frame: zlib's CRC-32 is the same polynomial with the bits of every byte mirrored and the result inverted, so bytes
are mirrored on the way in, and the result on the way out. Many: a CRC is linear, so what each byte adds depends on its
value and on how many bytes follow, and the CRC of a frame is the exclusive or of one table entry a byte.
"""

from __future__ import annotations

import zlib
from functools import cache

import numpy as np
import numpy.typing as npt

POLYNOMIAL = 0x04C11DB7
PRESET = 0xFFFFFFFF
_BYTE_VALUES = 256

ByteArray = npt.NDArray[np.uint8]
CrcArray = npt.NDArray[np.uint32]

_MIRRORED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def crc32_mpeg2(data: bytes) -> int:
    """The CRC of some bytes."""
    mirrored = zlib.crc32(data.translate(_MIRRORED)) ^ PRESET
    return int.from_bytes(mirrored.to_bytes(4, "little").translate(_MIRRORED), "big")


def crc32_mpeg2_of_rows(rows: ByteArray, *, padding: int = 0) -> CrcArray:
    """The CRC of each row of shape (n, length), shape (n,), as if `padding` zero bytes followed the row."""
    length = rows.shape[1]
    table, preset_share = _table(length + padding)
    entries = rows + _BYTE_VALUES * np.arange(length)  # a zero byte of padding adds nothing
    crc: CrcArray = np.bitwise_xor.reduce(table[entries], axis=1)
    return crc ^ preset_share


@cache
def _table(length: int) -> tuple[CrcArray, np.uint32]:
    """What each value adds at each place of `length` bytes, shape (length · 256,), and what the preset adds."""
    last = np.arange(_BYTE_VALUES, dtype=np.uint32) << 24
    for _ in range(8):
        last = (last << 1) ^ (last >> 31) * np.uint32(POLYNOMIAL)
    places = [last]
    for _ in range(length - 1):
        after = places[-1]
        places.append((after << 8) ^ last[after >> 24])
    return np.concatenate(places[::-1]), np.uint32(crc32_mpeg2(bytes(length)))
