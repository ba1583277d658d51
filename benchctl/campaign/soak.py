"""Decide when a soak is over: the air has been at the set point for long enough, and the gyro no longer drifts."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from benchctl.bench import Limits
from benchctl.plan import Soak
from benchctl_instruments.errors import SafetyError
from benchctl_instruments.interfaces import ChamberReading

SOAK_CHANNELS = ("poll_time_s", "poll_chamber_temp_c", "poll_chamber_setpoint_c", "poll_gyro_temp_c", "poll_gyro_v")

DRIFT_WINDOW_S = 600.0
"""The drift of the gyro's temperature is the slope over this time: noise of a few mK is then far below 0.02 °C/min."""


def one_poll(time_s: float, air: ChamberReading, more: dict[str, float]) -> dict[str, float]:
    """Return the polled channels of one reading of the chamber, and `more`."""
    return {
        "poll_time_s": time_s,
        "poll_chamber_temp_c": air.temperature_c,
        "poll_chamber_setpoint_c": air.setpoint_c,
        **more,
    }


@dataclass(slots=True)
class SoakWatch:
    """Follows a soak poll by poll; times in seconds since the start of the recording.

    `held_s` is how long the air has been within the tolerance; None while it is not.
    """

    step: Soak
    from_c: float
    begin_s: float
    limits: Limits
    state: str = "going to the set point"
    done: bool = False
    held_s: float | None = None
    drift_c_per_min: float = 0.0
    _within_since_s: float | None = None
    _gyro: deque[tuple[float, float]] = field(default_factory=deque)

    def see(self, now_s: float, air_c: float, gyro_c: float) -> None:
        """Update with a poll.

        Raises
        ------
        SafetyError
            The soak has not ended in time; the run does not wait indefinitely for a chamber that stalls.
        """
        step = self.step
        self._gyro.append((now_s, gyro_c))
        while now_s - self._gyro[0][0] > DRIFT_WINDOW_S:
            self._gyro.popleft()
        if abs(air_c - step.setpoint_c) > step.tolerance_c:
            self._within_since_s = None
            self.state = "going to the set point"
        elif self._within_since_s is None:
            self._within_since_s = now_s
            self.state = "soaking"
        self.held_s = None if self._within_since_s is None else now_s - self._within_since_s
        self.drift_c_per_min = drift = self._drift()
        has_held = self.held_s is not None and self.held_s >= step.hold_s
        self.done = has_held and abs(drift) <= step.drift_c_per_min
        if has_held and not self.done:
            self.state = f"waiting for the gyro, {drift:+.3f} °C/min"
        travel_s = abs(step.setpoint_c - self.from_c) / self.limits.ramp_c_per_min * 60.0
        if not self.done and now_s - self.begin_s > travel_s + step.hold_s + step.timeout_s:
            raise SafetyError(
                f"chamber: soak at {step.setpoint_c:+g} °C not over after {(now_s - self.begin_s) / 3600:.1f} h: air "
                f"at {air_c:+.1f} °C (tolerance {step.tolerance_c:g}), gyro drifts by {drift:+.3f} °C/min "
                f"(limit {step.drift_c_per_min:g}); look at the chamber"
            )

    def _drift(self) -> float:
        (first_s, first_c), (last_s, last_c) = self._gyro[0], self._gyro[-1]
        return (last_c - first_c) / (last_s - first_s) * 60.0 if last_s > first_s else 0.0
