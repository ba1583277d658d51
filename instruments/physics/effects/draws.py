"""Random draws that do not depend on how a run is cut: the draws of a scan are determined by the scan's number.

A counter-based generator (Philox) is created for every block of scans, with a key of the seed and the effect's name.
No state is carried between segments, and two effects with the same seed are independent.
"""

from __future__ import annotations

import zlib

import numpy as np

from benchctl_instruments.arrays import FloatArray

_BLOCK = 256
"""Scans that are drawn at once: few, since a single reading draws a complete block."""


def generator(seed: float, name: str, block: int) -> np.random.Generator:
    """Return an effect's generator for a block, 0 or more."""
    key = np.array([int(seed), zlib.crc32(name.encode())], dtype=np.uint64)
    # the counter's lowest word counts the draws, its highest the blocks
    counter = np.array([0, 0, 0, block], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key, counter=counter))


def normals(seed: float, name: str, first_scan: int, scans: int, columns: int) -> FloatArray:
    """Return independent standard normal numbers for consecutive scans, shape (scans, columns)."""
    low, high = first_scan // _BLOCK, (first_scan + scans - 1) // _BLOCK
    drawn = np.concatenate(
        [generator(seed, name, block).standard_normal((_BLOCK, columns)) for block in range(low, high + 1)]
    )
    skipped = first_scan - low * _BLOCK
    return drawn[skipped : skipped + scans]
