"""Chance that does not depend on how a run is cut: what belongs to a scan is drawn from the scan's own number.

A counter-based generator (Philox) is placed anew for every block of scans, under a key of the seed and the effect's
name. Nothing needs to be carried from one stretch to the next, and two effects of one seed share nothing.
"""

from __future__ import annotations

import zlib

import numpy as np

from benchctl_instruments.arrays import FloatArray

_BLOCK = 256
"""Scans that are drawn at once: few, since a single reading costs a whole block."""


def generator(seed: float, name: str, block: int) -> np.random.Generator:
    """The generator of a block, of 0 or more, for an effect."""
    key = np.array([int(seed), zlib.crc32(name.encode())], dtype=np.uint64)
    # the counter's lowest word counts the draws, its highest the blocks
    counter = np.array([0, 0, 0, block], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key, counter=counter))


def normals(seed: float, name: str, first_scan: int, scans: int, columns: int) -> FloatArray:
    """Independent standard normal numbers for scans from a first one on, shape (scans, columns)."""
    low, high = first_scan // _BLOCK, (first_scan + scans - 1) // _BLOCK
    drawn = np.concatenate(
        [generator(seed, name, block).standard_normal((_BLOCK, columns)) for block in range(low, high + 1)]
    )
    skipped = first_scan - low * _BLOCK
    return drawn[skipped : skipped + scans]
