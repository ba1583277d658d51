from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.protocols.frames import POLYNOMIAL, PRESET, crc32_mpeg2, crc32_mpeg2_of_rows

KVH_FRAME = bytes.fromhex("FE81FF55 37A96A6E 38586C1F B75BF862 BF803E78 BB650D28 3B0A37AC 773D0028")


def bit_by_bit(data: bytes) -> int:
    """The definition."""
    register = PRESET
    for byte in data:
        register ^= byte << 24
        for _ in range(8):
            register = (register << 1 ^ (POLYNOMIAL if register >> 31 else 0)) & 0xFFFFFFFF
    return register


def rows(*frames: bytes) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    return np.array([list(frame) for frame in frames], np.uint8)


def test_the_catalogue_of_algorithms_agrees() -> None:
    assert crc32_mpeg2(b"123456789") == 0x0376E6E7


def test_a_published_frame_of_a_kvh_gyro_agrees() -> None:
    assert crc32_mpeg2(KVH_FRAME) == 0x4BFA34D8
    assert crc32_mpeg2_of_rows(rows(KVH_FRAME, KVH_FRAME[::-1])).tolist() == [0x4BFA34D8, bit_by_bit(KVH_FRAME[::-1])]


def test_no_bytes_leave_the_preset() -> None:
    assert crc32_mpeg2(b"") == PRESET


@settings(deadline=None)
@given(st.binary(max_size=80))
def test_one_frame_agrees_with_the_definition(data: bytes) -> None:
    assert crc32_mpeg2(data) == bit_by_bit(data)


@settings(deadline=None)
@given(st.integers(1, 70), st.integers(0, 3), st.integers(0, 5), st.randoms(use_true_random=False))
def test_many_frames_agree_with_each_one_alone(length: int, padding: int, count: int, random: object) -> None:
    generator = np.random.default_rng(random.getrandbits(32))  # type: ignore[attr-defined]
    frames = generator.integers(0, 256, (count, length), dtype=np.uint8)
    expected = [bit_by_bit(frame.tobytes() + bytes(padding)) for frame in frames]
    assert crc32_mpeg2_of_rows(frames, padding=padding).tolist() == expected
