"""A digital gyro's blocks as they come, read by a thread of its own, so that nothing else of a run waits for them."""

from __future__ import annotations

import queue
import threading
from dataclasses import dataclass

from benchctl_instruments.errors import LinkError
from benchctl_instruments.interfaces import Clock, Gyro, GyroBlock

LOOK_S = 0.1
"""Wall time for which one read waits, and within which the thread ends."""

MOST_BLOCKS = 1024
"""Blocks that wait to be taken. Where there are so many the line is not read: what it loses the gyro's numbers tell."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Heard:
    """A block, and the clock's time at which the last of it had come."""

    block: GyroBlock
    stamp_s: float


class FramePump:
    """Reads a gyro's stream from when it is made until `stop`.

    `began_s` is the clock just before the gyro was asked to send, `runs_s` just after it agreed; `rate_hz` is what it
    says that it sends at, `silence` why nothing came when it was last listened to. Raises as `Gyro.start_stream`.
    """

    def __init__(self, gyro: Gyro, clock: Clock, rate_hz: float) -> None:
        self._gyro, self._clock = gyro, clock
        self.began_s = clock.now()
        self.rate_hz = gyro.start_stream(rate_hz)
        self.runs_s = clock.now()
        self.silence = "nothing came yet"
        self._heard: queue.Queue[Heard] = queue.Queue(MOST_BLOCKS)
        self._failure: Exception | None = None
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._read, name="gyro's frames", daemon=True)
        self._thread.start()

    def take(self, wait_s: float) -> list[Heard]:
        """All that has come and was not taken; where that is nothing, it waits so long by the wall for the next.

        Raises what ended the reading, if something did: a line that is silent does not.
        """
        taken: list[Heard] = []
        try:
            taken.append(self._heard.get(timeout=wait_s) if wait_s > 0.0 else self._heard.get_nowait())
            while True:
                taken.append(self._heard.get_nowait())
        except queue.Empty:
            if not taken and self._failure is not None:
                raise self._failure from None
            return taken

    def stop(self) -> None:
        """End the reading; the gyro itself is left as it is. Safe to call twice."""
        self._stopping.set()
        self._thread.join()

    def _read(self) -> None:
        while not self._stopping.is_set():
            try:
                heard = Heard(block=self._gyro.read_stream(1, LOOK_S), stamp_s=self._clock.now())
            except LinkError as err:
                self.silence = str(err)
                self._stopping.wait(LOOK_S / 10.0)  # a line that is gone says so at once, again and again
            except Exception as err:
                self._failure = err
                return
            else:
                self._put(heard)

    def _put(self, heard: Heard) -> None:
        while not self._stopping.is_set():
            try:
                self._heard.put(heard, timeout=LOOK_S)
            except queue.Full:
                continue
            return
