"""One pass over a recording: every step becomes a few hundred block means, small enough to be fitted many times.

A block is a short run of neighbouring samples; of the gyro its mean output is kept, of the encoder mean and variance of
the rate, so that the mean of a curved law f is f̄ ≈ ½[f(ω̄+s) + f(ω̄−s)], s² the variance (exact to the third moment).
The rate stands where the gyro felt it: a delay is estimated within each step in motion and the rate is evaluated there;
the mean acceleration and jerk let a fit move it by the little that is missing. Clipped, filled-in or non-finite samples
are left out with their block, and nothing is smoothed across a gap.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from benchctl.calibration.angle_rate import Smoother, choose_smoother, unwrap_deg
from benchctl.calibration.blocks import Blocks, Span, block_means, delay_of
from benchctl.calibration.settling import settled_from, whole_revolutions
from benchctl.recordings.mapped import FILLED
from benchctl.recordings.model import BenchFacts, Meta, Step, StepInfo, axis_of
from instruments.errors import UsageError

FloatArray = npt.NDArray[np.float64]

QUIET_BAND_HZ = 5.0
FREE_MOTION_BAND_HZ = 2.0
"""Band of the motion where a step in motion states no frequency."""

FREE_PIECE_S = 60.0
"""Into pieces of about this length a run in free motion is cut."""

QUIET_KINDS = ("static", "constant_rate")
UNUSED_KINDS = ("soak", "thermal_ramp", "unassigned", "static_points")
_SHORTEST = 32


@dataclass(frozen=True, slots=True, kw_only=True)
class ReducedStep:
    """A step as block means, arrays of shape (n,), oldest first.

    `kind` is `static`, `constant_rate` or `motion`. `rate_dps` is the table's, at the gyro's stamps less `delay_s`,
    `rate_at_stamp_dps` at the stamps;
    `rate_variance` that within the block (°/s)²; `encoder_basis`, shape (n, 4): the rate that the encoder shows too
    much per arc second of its error in sin θ, cos θ, sin 2θ, cos 2θ. `temperature_c` is a straight line through the
    thermistor's samples, NaN where there are none. `masked` samples were left out as clipped, filled in or not finite,
    `unsettled` as spin-up.
    """

    info: StepInfo
    kind: str
    time_s: FloatArray
    count: FloatArray
    block_s: float
    output_v: FloatArray
    rate_dps: FloatArray
    rate_at_stamp_dps: FloatArray
    rate_variance: FloatArray
    acceleration_dps2: FloatArray
    jerk_dps3: FloatArray
    temperature_c: FloatArray
    encoder_basis: FloatArray
    delay_s: float
    duration_s: float
    revolutions: float
    smoother: Smoother
    masked: int
    unsettled: int
    piece: int = 0

    @property
    def key(self) -> tuple[int, int]:
        """Which step of the recording, and which piece of it where a long run in free motion was cut into several."""
        return self.info.index, self.piece

    @property
    def samples(self) -> int:
        """Samples behind the blocks."""
        return int(self.count.sum())

    @property
    def peak_rate_dps(self) -> float:
        """Largest rate of a block."""
        return float(np.max(np.abs(self.rate_dps)))

    @property
    def mean_temperature_c(self) -> float:
        """Mean of the thermistor, NaN where there is none."""
        return float(np.mean(self.temperature_c))


def reduce_steps(steps: Iterable[Step], meta: Meta) -> Iterator[ReducedStep]:
    """Reduce every step that a calibration can use; soaks and thermal ramps are passed over.

    Raises `UsageError` where a step to be used lacks the encoder or the gyro's output.
    """
    for step in steps:
        if step.info.kind in UNUSED_KINDS or step.info.role == "none":
            continue
        for number, piece in enumerate(_pieces(step)):
            reduced = reduce_step(piece, meta)
            if reduced is not None:
                yield replace(reduced, piece=number)


def _pieces(step: Step) -> Iterator[Step]:
    """A long run in free motion as several, so that some can be kept aside and their scatter be seen; others whole."""
    time = step.channels.get("time_s")
    if step.info.kind in QUIET_KINDS or step.info.frequency_hz is not None or time is None or time.size < 2:
        yield step
        return
    number = max(1, int((time[-1] - time[0]) / FREE_PIECE_S))
    edges = np.linspace(0, time.size, number + 1).astype(np.int64)
    for start, stop in pairwise(map(int, edges)):
        channels = {name: values[start:stop] for name, values in step.channels.items() if axis_of(name) == "time_s"}
        yield Step(replace(step.info, t_start=float(time[start]), t_end=float(time[stop - 1])), channels)


def reduce_step(step: Step, meta: Meta) -> ReducedStep | None:
    """Reduce one step; None where nothing of it can be used (too short, never settled, all clipped)."""
    _demand_channels(step)
    time, info = step["time_s"], step.info
    if time.size < _SHORTEST:
        return None
    interval = float(np.median(np.diff(time)))
    rate_hz = float(f"{1.0 / interval:.9g}")
    turned = unwrap_deg(step["encoder_deg"][np.isfinite(step["encoder_deg"])])
    coarse = max(1, int(0.1 * rate_hz))
    rate_rms = (
        float(np.std(turned[coarse:] - turned[:-coarse])) * rate_hz / coarse if info.kind not in QUIET_KINDS else 1.0
    )
    smoother = choose_smoother(rate_hz, _band_hz(info, rate_hz), _angle_noise_deg(meta.bench) / max(rate_rms, 0.1))
    spans, masked, unsettled = _usable_spans(step, meta, smoother, interval)
    if not spans:
        return None
    delay = 0.0 if info.kind in QUIET_KINDS else delay_of(max(spans, key=lambda span: span.time_s.size), smoother)
    parts = [
        blocks
        for span in spans
        if (blocks := block_means(span, smoother, kind=info.kind, frequency_hz=info.frequency_hz, delay_s=delay))
    ]
    if sum(part.count.size for part in parts) < 4:
        return None

    def joined(name: str) -> FloatArray:
        return np.concatenate([getattr(part, name) for part in parts])

    count, stamps = joined("count"), joined("time_s")
    intercept, slope = _temperature_line(step)
    return ReducedStep(
        info=info,
        kind=info.kind if info.kind in QUIET_KINDS else "motion",
        time_s=stamps,
        count=count,
        block_s=float(np.median(count)) * interval,
        output_v=joined("output_v"),
        rate_dps=joined("rate_dps"),
        rate_at_stamp_dps=joined("rate_at_stamp_dps"),
        rate_variance=joined("rate_variance"),
        acceleration_dps2=joined("acceleration_dps2"),
        jerk_dps3=joined("jerk_dps3"),
        temperature_c=intercept + slope * stamps,
        encoder_basis=joined("encoder_basis"),
        delay_s=delay,
        duration_s=float(count.sum()) * interval,
        revolutions=_revolutions(parts, interval),
        smoother=smoother,
        masked=masked,
        unsettled=unsettled,
    )


def _demand_channels(step: Step) -> None:
    """Raise where a channel that a calibration cannot do without is missing."""
    for channel in ("time_s", "encoder_deg", "gyro_v"):
        if channel not in step.channels:
            raise UsageError(
                f"step {step.info.index} '{step.info.name}': a calibration needs the channel {channel}, the step has "
                f"{', '.join(sorted(step.channels)) or 'none'}; import the recording with a map that names it"
            )


def _usable_spans(step: Step, meta: Meta, smoother: Smoother, interval: float) -> tuple[list[Span], int, int]:
    """Unbroken, settled spans; how many samples are clipped, filled in or not finite; how many had not settled."""
    kind, seen = step.info.kind, np.isfinite(step["encoder_deg"])  # an angle that is missing makes a gap
    time, angle, output = (step[channel][seen] for channel in ("time_s", "encoder_deg", "gyro_v"))
    bad = ~np.isfinite(output) | clipped(output, meta)
    if FILLED in step.channels:
        bad |= step[FILLED][seen] > 0.5
    spans: list[Span] = []
    unsettled = 0
    for part in _unbroken(time, interval):
        unwrapped = unwrap_deg(angle[part])
        first, last = 0, unwrapped.size
        if kind in QUIET_KINDS:
            settled = settled_from(unwrapped, smoother, _angle_noise_deg(meta.bench))
            if settled is None or settled > last - _SHORTEST:
                unsettled += last
                continue
            first, unsettled = settled, unsettled + settled
        if kind == "constant_rate":
            # The smoother's ends fall off both sides of the span; whole revolutions are counted between them.
            inside = unwrapped[first + smoother.half : last - smoother.half]
            if inside.size:
                last = first + whole_revolutions(inside) + 2 * smoother.half
        chosen = slice(part.start + first, part.start + last)
        spans.append(
            Span(
                time_s=time[chosen],
                angle_deg=unwrapped[first:last],
                output_v=np.nan_to_num(output[chosen]),
                bad=bad[chosen],
            )
        )
    return spans, int(bad.sum() + (~seen).sum()), unsettled


def _band_hz(info: StepInfo, sample_rate_hz: float) -> float:
    """The band in which the rate must be faithful."""
    if info.kind in QUIET_KINDS:
        return min(QUIET_BAND_HZ, sample_rate_hz / 20)
    if info.frequency_hz is not None:
        return info.frequency_hz
    return min(FREE_MOTION_BAND_HZ, sample_rate_hz / 20)


def _angle_noise_deg(bench: BenchFacts) -> float:
    """Quantisation of the encoder as a standard deviation, deg; 1″ where its counts are not known."""
    if bench.encoder_counts_per_rev > 0:
        return float(360.0 / bench.encoder_counts_per_rev / np.sqrt(12.0))
    return 1.0 / 3600.0


def clipped(output: FloatArray, meta: Meta) -> npt.NDArray[np.bool_]:
    """Samples at the converter's ends, or at the output's limit where the lab states one; shape (n,)."""
    limit = np.inf
    if meta.bench.adc_range_v > 0:
        codes = 2.0 ** (meta.bench.adc_bits - 1) if meta.bench.adc_bits else 2.0**15
        limit = meta.bench.adc_range_v * (1 - 2 / codes)
    stated = (meta.simulation or {}).get("output_limit_v")
    if isinstance(stated, int | float) and stated > 0:
        limit = min(limit, 0.999 * float(stated))
    return np.asarray(np.abs(output) >= limit)


def _unbroken(time: FloatArray, interval: float) -> Iterator[slice]:
    """Spans without a gap that are long enough to be of use."""
    breaks = np.flatnonzero(np.abs(np.diff(time) - interval) > 0.5 * interval) + 1
    for start, stop in zip([0, *breaks], [*breaks, time.size], strict=True):
        if stop - start >= _SHORTEST:
            yield slice(int(start), int(stop))


def _temperature_line(step: Step) -> tuple[float, float]:
    """Intercept (at time 0 of the recording) and slope over time of the thermistor; NaN where there is none."""
    readings = step.channels.get("gyro_temp_c")
    if readings is None:
        return np.nan, 0.0
    good = np.isfinite(readings)
    if int(good.sum()) < 2:
        return np.nan, 0.0
    time = step["time_s"][good]
    centred = time - time.mean()
    slope = float(centred @ readings[good] / (centred @ centred))
    return float(readings[good].mean() - slope * time.mean()), slope


def _revolutions(parts: list[Blocks], interval: float) -> float:
    """Revolutions turned within the blocks, in either sense."""
    return float(sum(np.sum(np.abs(part.rate_dps) * part.count) for part in parts) * interval / 360.0)
