from __future__ import annotations

import threading

import numpy as np
import pytest

from benchctl.recordings.step_writer import Waiting
from benchctl_instruments.errors import UsageError

NAMES = ("time_s", "gyro_v")


def test_points_and_blocks_come_out_in_the_order_in_which_they_came_in() -> None:
    waiting = Waiting("step 1", NAMES)
    waiting.add_point({"gyro_v": 10.0, "time_s": 0.0})
    waiting.add_block({"time_s": np.array([1.0, 2.0]), "gyro_v": np.array([11.0, 12.0]), "poll_time_s": np.zeros(7)})
    waiting.add_point({"time_s": np.float64(3.0), "gyro_v": 13})
    rows = waiting.take()
    assert rows.tolist() == [[0.0, 10.0], [1.0, 11.0], [2.0, 12.0], [3.0, 13.0]]
    assert (waiting.added, waiting.written) == (4, 0)


def test_what_was_taken_and_not_written_is_taken_again_with_what_came_since() -> None:
    waiting = Waiting("step 1", NAMES)
    waiting.add_point({"time_s": 0.0, "gyro_v": 1.0})
    assert len(waiting.take()) == 1
    waiting.add_point({"time_s": 1.0, "gyro_v": 1.0})
    rows = waiting.take()
    assert rows[:, 0].tolist() == [0.0, 1.0]
    waiting.let_go(len(rows))
    assert waiting.take().shape == (0, 2)
    assert waiting.written == 2


def test_a_block_may_be_changed_by_its_owner_afterwards() -> None:
    waiting = Waiting("step 1", NAMES)
    block = {name: np.ones(3) for name in NAMES}
    waiting.add_block(block)
    block["gyro_v"][:] = 0.0
    assert waiting.take()[:, 1].tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize(
    ("point", "says"),
    [
        ({"time_s": 0.0}, r"step 1: expected all of \['gyro_v', 'time_s'\] together, got \['time_s'\]"),
        ({"time_s": 0.0, "gyro_v": 1.0, "odd": 2.0}, "expected all of .* got .*'odd'"),
        ({"time_s": 0.0, "gyro_v": "1.0"}, "step 1: expected a point with one number a channel, got .*'1.0'"),
        ({"time_s": 0.0, "gyro_v": None}, "one number a channel"),
        ({"time_s": 0.0, "gyro_v": [1.0]}, "one number a channel"),
    ],
)
def test_a_point_that_does_not_fit_is_refused_and_not_kept(point: dict[str, float], says: str) -> None:
    waiting = Waiting("step 1", NAMES)
    with pytest.raises(UsageError, match=says):
        waiting.add_point(point)
    assert (waiting.added, len(waiting.take())) == (0, 0)


def test_nothing_is_lost_or_doubled_while_another_thread_takes() -> None:
    waiting, taken, over = Waiting("step 1", NAMES), [], threading.Event()

    def take() -> None:
        while not over.is_set() or waiting.added > waiting.written:
            rows = waiting.take()
            taken.append(rows)
            waiting.let_go(len(rows))

    taker = threading.Thread(target=take)
    taker.start()
    for number in range(50_000):
        waiting.add_point({"time_s": float(number), "gyro_v": 0.0})
    over.set()
    taker.join()
    assert np.array_equal(np.concatenate(taken)[:, 0], np.arange(50_000.0))
    assert len(taken) > 1
