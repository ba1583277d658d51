"""Time stamps as float64, eight bytes each, that claim to be a clock."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from benchctl.recordings.stamps import StampError, printed_resolution, repair, require_uniform
from tests.fuzz.harness import Harness


def one_input(data: bytes) -> None:
    stamps = np.frombuffer(data[1 : len(data) - (len(data) - 1) % 8], dtype="<f8").astype(np.float64)
    stamps = stamps[np.isfinite(stamps)]  # the reader of columns lets nothing else pass
    if stamps.size < 3:
        return
    with _refused_rows(stamps.size):
        base = repair(stamps, np.r_[False, stamps[1:] == stamps[:-1]], fill=data[0] % 2 == 1)
        assert np.isfinite(base.time_s).all()
        assert base.time_s.size <= 3 * stamps.size
        base.place(stamps)
    with _refused_rows(stamps.size):
        require_uniform(stamps, 10.0, printed_resolution(stamps[np.abs(stamps) < 1e12]))


@contextmanager
def _refused_rows(rows: int) -> Iterator[None]:
    refused = 0
    try:
        yield
    except StampError as err:
        refused = err.row
    assert 0 <= refused < rows


def seeds() -> list[bytes]:
    clock = np.arange(20) / 10.0
    return [
        b"\0" + clock.tobytes(),
        b"\1" + np.delete(clock, [5, 6]).tobytes(),
        b"\0" + np.r_[clock[:4], clock[3:]].tobytes(),
        b"\1" + (clock * 1e300).tobytes(),
        b"\1" + (clock * 1e-320).tobytes(),
    ]


HARNESS = Harness(name="stamps", weight=60, one_input=one_input, seeds=seeds, longest=2048)
