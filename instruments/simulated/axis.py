"""The rate table of the simulated bench: a motion plan in closed form, replaced by the next demand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.servo import Motion, Segment, coast, follow, with_ripple
from benchctl_instruments.physics.table import Piece, TableParameters, to_angle, to_rate, to_sine
from benchctl_instruments.simulated.clock import Timebase
from benchctl_instruments.simulated.machines import TableMotion

_LONG_AGO_S = -100.0


class TableAxis:
    """A `TableMachine`. It starts at rest with the servo off; while the servo is off, demands have no effect."""

    def __init__(self, timebase: Timebase, parameters: TableParameters) -> None:
        self._timebase = timebase
        self._parameters = parameters
        self._rate_limit_dps = parameters.rate_limit_dps
        self._acceleration_limit_dps2 = parameters.acceleration_limit_dps2
        self._closed = False
        self._segments = [coast(Piece(angle_deg=parameters.start_angle_deg), _LONG_AGO_S)]
        self._last_look: tuple[float, TableMotion] | None = None  # of the present plan

    def motion(self) -> TableMotion:
        """Return the present true motion, cached since a controller often reads it several times at one instant."""
        with self._timebase.lock:
            now = self._timebase.now()
            if self._last_look is None or self._last_look[0] != now:
                self._last_look = now, self._motion_at(now)
            return self._last_look[1]

    def at(self, times_s: FloatArray) -> Motion:
        """Return the true motion at instants of shape (n,), in increasing order, as far back as the history is kept."""
        with self._timebase.lock:
            return with_ripple(self._parameters, self._unrippled(times_s))

    def close_loop(self) -> None:
        """Switch the servo on; a coasting table is stopped."""
        with self._timebase.lock:
            if not self._closed:
                self._closed = True
                self._bring_to_rest(self._acceleration_limit_dps2)

    def open_loop(self) -> None:
        """Switch the servo off; friction brings the table to rest."""
        with self._timebase.lock:
            if self._closed:
                self._closed = False
                self._bring_to_rest(self._parameters.friction_dps2)

    def limits(self) -> tuple[float, float]:
        """Return the limits of rate [deg/s] and acceleration [deg/s²]."""
        return self._rate_limit_dps, self._acceleration_limit_dps2

    def set_limits(self, rate_dps: float, acceleration_dps2: float) -> None:
        """Set the limits for later demands."""
        if not (rate_dps > 0.0 and acceleration_dps2 > 0.0):
            raise UsageError(f"limits of {rate_dps} deg/s and {acceleration_dps2} deg/s²; give both above 0")
        with self._timebase.lock:
            self._rate_limit_dps, self._acceleration_limit_dps2 = rate_dps, acceleration_dps2

    def demand_rate(self, rate_dps: float) -> None:
        """Turn at a constant rate, clipped to the limit."""
        target_dps = max(-self._rate_limit_dps, min(self._rate_limit_dps, rate_dps))
        self._demand(lambda angle, rate: to_rate(angle, rate, target_dps, self._acceleration_limit_dps2))

    def demand_angle(self, angle_deg: float) -> None:
        """Go to an unwrapped angle in the shortest time, and hold it."""
        self._demand(
            lambda angle, rate: to_angle(angle, rate, angle_deg, self._rate_limit_dps, self._acceleration_limit_dps2)
        )

    def demand_sine(self, amplitude_deg: float, frequency_hz: float, phase_deg: float, slew_deg_per_s: float) -> None:
        """Oscillate about the present angle; a turning table is stopped first: `physics.table.to_sine`."""
        self._demand(
            lambda angle, rate: to_sine(
                angle,
                rate,
                amplitude_deg=amplitude_deg,
                frequency_hz=frequency_hz,
                phase_deg=phase_deg,
                growth_deg_per_s=slew_deg_per_s,
                rate_limit_dps=self._rate_limit_dps,
                acceleration_dps2=self._acceleration_limit_dps2,
            )
        )

    def _demand(self, profile: Callable[[float, float], tuple[Piece, ...]]) -> None:
        """Start a new profile at the presently demanded angle and rate."""
        with self._timebase.lock:
            if self._closed:
                at_s = self._timebase.next_instant()
                leading = self._until(at_s)[-1]
                angle_deg, rate_dps, _ = leading.piece.at(at_s - leading.start_s)
                self._replan(at_s, profile(angle_deg, rate_dps))

    def _bring_to_rest(self, acceleration_dps2: float) -> None:
        """Start a stop at the present angle and rate of the table."""
        at_s = self._timebase.next_instant()
        angle_deg, rate_dps = _state(self._until(at_s)[-1], at_s)
        self._replan(at_s, to_rate(angle_deg, rate_dps, 0.0, acceleration_dps2))

    def _until(self, at_s: float) -> list[Segment]:
        """Return the segments that begin before an instant; the last one extends to it."""
        return [segment for segment in self._segments if segment.start_s < at_s]

    def _replan(self, at_s: float, pieces: tuple[Piece, ...]) -> None:
        """Replace the plan from an instant on by consecutive pieces; drop segments that are no longer needed."""
        segments = self._until(at_s)
        past = sum(segment.start_s <= self._timebase.forgettable_s() for segment in segments)
        segments = segments[max(past - 1, 0) :]
        for piece in pieces:
            angle_deg, rate_dps = _state(segments[-1], at_s)
            if self._closed:
                segments.append(follow(self._parameters, piece, at_s, angle_deg, rate_dps))
            else:
                segments.append(coast(piece, at_s))
            at_s += piece.duration_s
        self._segments, self._last_look = segments, None

    def _motion_at(self, time_s: float) -> TableMotion:
        motion = self.at(np.array([time_s]))
        return TableMotion(
            angle_deg=float(motion.angle_deg[0]),
            rate_dps=float(motion.rate_dps[0]),
            acceleration_dps2=float(motion.acceleration_dps2[0]),
        )

    def _unrippled(self, times_s: FloatArray) -> Motion:
        if times_s[0] < self._segments[0].start_s:
            raise UsageError(
                f"the motion at {times_s[0]:.3f} s is forgotten, it is known since {self._segments[0].start_s:.3f} s;"
                " hold the history before the next demand"
            )
        starts = np.searchsorted(times_s, [segment.start_s for segment in self._segments])
        bounds = [0, *starts[1:].tolist(), times_s.size]
        parts = [
            segment.at(times_s[low:high])
            for segment, low, high in zip(self._segments, bounds[:-1], bounds[1:], strict=True)
            if high > low
        ]
        if len(parts) == 1:
            return parts[0]
        return Motion(
            np.concatenate([part.angle_deg for part in parts]),
            np.concatenate([part.rate_dps for part in parts]),
            np.concatenate([part.acceleration_dps2 for part in parts]),
        )


def _state(segment: Segment, time_s: float) -> tuple[float, float]:
    """Return angle [deg] and rate [deg/s] before ripple at an instant."""
    motion = segment.at(np.array([time_s]))
    return float(motion.angle_deg[0]), float(motion.rate_dps[0])
