"""A gyro's recording as a diagnosis problem: the lab's model, the hypotheses, and the coordinates of a mismatch."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from benchctl.diagnosis.gyro.angle_lines import lines_of_angle
from benchctl.diagnosis.gyro.baseline import GyroBaseline
from benchctl.diagnosis.gyro.chain import GyroChain, Law
from benchctl.diagnosis.gyro.encoder_noise import rate_variance, steadied_rate
from benchctl.diagnosis.gyro.frame import Frame, frame_of
from benchctl.diagnosis.gyro.frame_subsample import pieces_of, thinned
from benchctl.diagnosis.gyro.limits import at_rest, limits_of
from benchctl.diagnosis.gyro.model import checked_model, straight_line
from benchctl.diagnosis.gyro.noisy_reference import without_noise
from benchctl.diagnosis.gyro.response import Contrast, Response, contrast_of, response_of
from benchctl.diagnosis.gyro.rounding import rounding_between
from benchctl.diagnosis.gyro.subsample import most_rows
from benchctl.diagnosis.series import cut
from benchctl.estimation.wandering import PROCESSES
from benchctl.recordings.model import StepInfo
from benchctl.recordings.reader import Recording
from benchctl.signals.binning import hats
from benchctl.signals.free_band import Band, band_of, shared_motion
from benchctl.signals.rate import WIDE, differentiator, edges_hz, filtered_along
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.effects.effect import DescribedEffect, PhysicalEffect
from benchctl_instruments.physics.effects.kinds import FilterEffect, NoiseEffect
from benchctl_instruments.physics.effects.registry import effects
from benchctl_instruments.physics.gyro import earth_rate_dps
from benchctl_instruments.physics.structure_places import SETPOINT_WAY

_TURN = 360.0
_MANY, _PIECE = 3_000_000, 8
"""Minimum rows for a first search on fewer rows; length of its pieces, as a multiple of the filters' reach."""
_ROOM_C = 20.0
"""Reference temperature if no model is stated."""
_FEWEST_IN_BAND = 100
_MOST_LEAD_S = 1.0 / (2.0 * math.pi * 25.0)
"""Maximum lead by an acceleration term, the delay of a 25 Hz low-pass; more is not the strain of a coil."""
_LEAST_UNCLIPPED = 0.1
_MOST_SCALE = 2.0
"""Maximum ratio to a stated scale factor: parts and wiring cannot change it more, but a wrong model can."""
_KNOTS, _RIDGE = 12, 1e-9
_FEWEST_ROWS = 100
_CONSTANT = 1e-9  # relative peak-to-peak; a 24-bit converter resolves 6e-8
_FEWEST_STEPS = 12
"""With fewer steps none can be held out; they are cut into pieces."""


@dataclass(frozen=True, kw_only=True)
class GyroProblem(GyroBaseline):
    """A `PartProblem`: the gyro's volts from the encoder's motion and the thermistor.

    Its rows are those of the frame or, if the motion goes beyond the filters' band, the slow part of some of them
    (`band`). `earth_dps` is the Earth's rate about the table's axis, 0 if the table's location is unknown; `rounding_v`
    (n,) is the contribution of a coarse converter's steps to the output. `response` and `contrast` are compared above
    the band; `rails` are those observed in its samples. Each value of the output is repeated in `rows_per_value` rows.
    """

    frame: Frame
    chain: GyroChain
    adc_step_v: float
    usable: BoolArray
    earth_dps: float = 0.0
    rounding_v: FloatArray | None = None
    band: Band | None = None
    response: Response | None = None
    contrast: Contrast | None = None
    encoder_step_deg: float = 0.0
    rails: tuple[PhysicalEffect, ...] = ()
    rows_per_value: int = 1
    in_motion: ClassVar[bool] = True

    @cached_property
    def noises(self) -> frozenset[str]:
        """Random walk of the bias, flicker, and noise that grows with the rate.

        Noise of the reference within the band of its motion is as slow as the first two.
        """
        slow = set() if self.frame.noisy_within else set(PROCESSES)
        return frozenset({*slow, "noise_rate_dependent"} - self.without)

    @cached_property
    def regressor_variance(self) -> tuple[FloatArray, FloatArray]:
        """Variance [V²] due to the encoder's noise, and half that of its change from row to row; (n,) each."""
        variance, step = rate_variance(self.frame)
        squared = float(self.simulation["K0_v_per_dps"]) ** 2 * (self.band is None)
        return self._kept(squared * variance), self._kept(squared * step)

    @cached_property
    def measured(self) -> FloatArray:
        """The gyro's output [V], shape (n,)."""
        volts = self.slow(self.frame.volts)
        return volts if self.rounding_v is None else volts - self.rounding_v

    @property
    def time_s(self) -> FloatArray:
        """Time stamps since the start of the recording [s], shape (n,)."""
        return self._kept(self.frame.time_s)

    @property
    def clock_s(self) -> FloatArray:
        """Time since the start of the recording that a stretch belongs to [s], shape (n,)."""
        clock = self.time_s.copy()
        for part, origin_s in zip(self.stretches, self.frame.origins_s, strict=True):
            clock[part] -= origin_s
        return clock

    @property
    def interval_s(self) -> float:
        """Interval between two rows [s]."""
        return self.frame.interval_s if self.band is None else self.frame.interval_s * self.band.every

    @property
    def stretches(self) -> tuple[slice, ...]:
        """The parts without gaps."""
        return self.frame.stretches if self.band is None else self.band.kept_stretches

    @property
    def step(self) -> IntArray:
        """Index of each row's step, shape (n,)."""
        return self.frame.step if self.band is None else self.frame.step[self.band.rows]

    @property
    def coil_c(self) -> FloatArray:
        """Temperatures of the gyro at the frame's rows [°C], shape (n,)."""
        return self.frame.temp_c

    @property
    def steps(self) -> tuple[StepInfo, ...]:
        """The recording's own steps."""
        return self.frame.infos

    @cached_property
    def recorded(self) -> IntArray:
        """Index of the joined recording of each step, shape (m,)."""
        begun_s = np.unique(self.frame.origins_s)
        firsts = np.searchsorted(self.frame.step, np.arange(len(self.steps)))
        return np.searchsorted(begun_s, self.frame.time_s[firsts], "right") - 1

    @cached_property
    def baseline_bounds(self) -> Mapping[str, tuple[float, float]]:
        """A stated scale factor is known within a factor of two; a fitted one is not bounded."""
        K0 = float(self.simulation["K0_v_per_dps"])
        low, high = sorted((K0 / _MOST_SCALE, K0 * _MOST_SCALE))
        return {"K0_v_per_dps": (low, high)} if self.believed else {}

    @cached_property
    def circumstances(self) -> Mapping[str, float]:
        """Reference temperature, rated range, the converter's step, start time."""
        return {
            "T0_c": self.law.T0_c,
            "range_dps": self.range_dps,
            "adc_step_v": self.adc_step_v,
            "start_s": 0.0,
        }

    @cached_property
    def effects(self) -> Mapping[str, type[DescribedEffect]]:
        """The effects of the vocabulary that change a prediction, without excluded ones.

        A coarse converter is detected in the samples themselves (`faults`). With a band, mains and encoder lines and
        momentary filters are excluded, and other effects of the momentary rate require that the fast motion is known.
        An overload, which can imitate a fold, is tested in static points only. The processor of a digital gyro counts
        its fringes, if any.
        """
        without = {*self.without, "adc_coarse", "overload"}
        if self.unit != "V":
            without.add("fringe_ambiguity")
        if self.band is not None:  # aliased motion causes such lines
            without |= {"mains_pickup", "encoder_interpolation"}

        def unknown(kind: type[PhysicalEffect]) -> bool:
            return self.chain.fast_dps is None or issubclass(kind, FilterEffect)

        most = abs(float(self.simulation["K0_v_per_dps"])) * _MOST_LEAD_S
        plausible = {"angular_acceleration": {"v_per_dps2": (-most, most)}}
        return {
            name: kind.within(plausible[name]) if name in plausible else kind
            for name, kind in effects().items()
            if name not in without
            and not issubclass(kind, NoiseEffect)
            and not (kind.momentary and self.band is not None and unknown(kind))
        }

    @cached_property
    def coordinates(self) -> Mapping[str, FloatArray]:
        """The coordinates in which a mismatch can occur, each of shape (n,)."""
        frame, rate = self.frame, steadied_rate(self.frame)
        every_row = {
            "time": frame.time_s,
            "rate": rate,
            "abs_rate": np.abs(rate),
            "rate_sign": np.sign(np.where(np.abs(rate) < 0.5, 0.0, rate)),
            "acceleration": frame.acceleration_dps2,
            "angle": np.mod(frame.angle_deg, _TURN),
            "gyro_temp": frame.temp_c,
            "gyro_temp_rate": frame.temp_rate_c_per_s,
            "chamber_temp": frame.chamber_c,
            "output": frame.volts,
            "step": frame.step.astype(np.float64),
        }
        if SETPOINT_WAY in frame.auxiliary:
            every_row["setpoint"] = frame.auxiliary[SETPOINT_WAY]
        return {name: self._kept(values) for name, values in every_row.items()}

    def require_rows(self, recording: Recording) -> None:
        """Raise `UsageError` if too few rows are usable, or if the output is constant."""
        usable = np.count_nonzero(self.usable)
        output = self.measured[self.usable] if usable else self.measured
        if np.ptp(output) <= _CONSTANT * np.abs(output).max():
            raise UsageError(
                f"{recording.path}: gyro_v is {output[0]:.6g} in all {output.size} rows; check that the gyro is powered"
                " and that the right channel was recorded"
            )
        if usable < _FEWEST_ROWS:
            band = "" if self.band is None else f", and motion faster than {self.band.up_to_hz:.2g} Hz,"
            raise UsageError(
                f"{recording.path}: {usable} of {self.usable.size} rows can be compared with a model, a diagnosis needs"
                f" {_FEWEST_ROWS}: rows at a rail, held, near a gap or near an end{band} are left out; record longer"
                " without gaps"
            )

    def predict(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """Return the predicted volts, shape (n,).

        In a slow band, effects of the momentary rate contribute their mean at each slow output; the remainder depends
        on motion between the samples, which is unknown.
        """
        volts = self.slow(self.chain.predict(baseline, (*effects, *self.rails)))
        lasting = [effect for effect in effects if not effect.momentary]
        if self.band is None or len(lasting) == len(effects) + len(self.rails):
            return volts
        slow = self.slow(self.chain.predict(baseline, lasting))
        return slow + self._on_the_average(volts - slow, slow)

    def spectral_residual(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """Return the errors of gain and phase above the band and of the contrast, scaled to its noise, shape (w,)."""
        parts = [one for one in (self.response, self.contrast) if one is not None]
        if not parts or self.band is None:
            return np.zeros(0)
        volts = self.chain.predict(baseline, (*effects, *self.rails))
        return self.band.noise * np.concatenate([one.residual(volts) for one in parts])

    @cached_property
    def spectral_step(self) -> IntArray:
        """The step of each element of `spectral_residual`, shape (w,)."""
        of_response = () if self.response is None else (self.response.step,)
        of_contrast = () if self.contrast is None else (self.contrast.steps,)
        return np.concatenate([np.zeros(0, np.int64), *of_response, *of_contrast])

    def forget(self) -> None:
        """Release the last results of the chain's stages, which are arrays as long as the recording."""
        self.chain.forget()

    def _on_the_average(self, change: FloatArray, along: FloatArray) -> FloatArray:
        """Return a change as a piecewise linear function of `along`, fitted to the usable rows; (n,) each."""
        lines = hats(along, np.linspace(along.min(), along.max(), _KNOTS))
        known = lines[self.usable]
        normal = (known.T @ known).toarray()
        normal += _RIDGE * np.trace(normal) * np.eye(_KNOTS)
        return np.asarray(lines @ np.linalg.solve(normal, known.T @ change[self.usable]))

    def _kept(self, values: FloatArray) -> FloatArray:
        return values if self.band is None else values[self.band.rows]

    def slow(self, values: FloatArray) -> FloatArray:
        """Return the part of the frame's rows (n,) that is compared, shape (m,)."""
        return values if self.band is None else self.band.slow(values)

    def otherwise(self) -> Self | None:
        """Return the problem without the Earth's rate, or with it again; None if it is unknown.

        A gyro measures it, but the recording of a simulation, or of a wrongly stated location, may not contain it.
        """
        if not self.earth_dps:
            return None
        chain = self.chain
        return replace(
            self, chain=GyroChain(chain.frame, chain.law, 0.0 if chain.earth_dps else self.earth_dps, chain.fast_dps)
        )

    @property
    def is_long(self) -> bool:
        """Whether there are so many rows that what is obvious is searched on a part of them first."""
        return self.frame.rows >= _MANY

    def thinned(self) -> Self | None:
        """Return the problem on a few seconds of many steps for a very long recording, else None."""
        one_recording = len(set(self.frame.origins_s)) == 1
        if not self.is_long or self.band is not None or not one_recording:
            return None
        reach = self.frame.reach
        frame, rows = thinned(self.frame, pieces_of(self.frame, _PIECE * reach))
        usable = self.usable[rows]
        for part in frame.stretches:  # rows within the reach of the output's filters
            usable[part.start : part.start + reach] = False
            usable[max(part.stop - reach, part.start) : part.stop] = False
        chain = GyroChain(frame, self.chain.law, self.chain.earth_dps)
        rounding_v = None if self.rounding_v is None else self.rounding_v[rows]
        return replace(self, frame=frame, chain=chain, usable=usable, rounding_v=rounding_v)

    def unrounded(self, predicted: FloatArray, step_v: float) -> Self:
        """Return the problem without the rounding by a coarse converter of an output `predicted`, shape (n,)."""
        rows, volts = self.usable, self.slow(self.frame.volts)
        rounding = rounding_between(predicted[rows], volts[rows], step_v)
        return replace(self, rounding_v=rounding.mean_v(predicted) - predicted)

    def behind(self, rails: PhysicalEffect, clipped: BoolArray) -> Self:
        """Return the problem with rails that the samples `clipped` (n,) have reached.

        For clipped motion, the filter of `shared_motion` passes only the share that is not clipped (Bussgang, 1952).
        """
        chain, share = self.chain, max(1.0 - float(clipped.mean()), _LEAST_UNCLIPPED)
        fast_dps = None if chain.fast_dps is None else chain.fast_dps / share
        return replace(
            self,
            rails=(rails,),
            chain=GyroChain(chain.frame, chain.law, chain.earth_dps, fast_dps),
            without=self.without | {"saturation", "two_rails"},
        )

    def remarks(self, before: FloatArray, after: FloatArray, heldout: BoolArray) -> tuple[str, ...]:
        """Return remarks on what this recording cannot show, and on lines that repeat with the angle."""
        del before, after, heldout
        frame = self.frame
        moving = _usable(frame, np.inf, None)
        lines = lines_of_angle(
            angle_deg=frame.encoder_deg,
            rate_dps=frame.rate_dps,
            felt=(frame.volts - float(self.simulation["U0_v"])) / float(self.simulation["K0_v_per_dps"]),
            rows=moving,
            interval_s=frame.interval_s,
        )
        left_out = (
            f"The recording shows no Earth rate, though {self.earth_dps:.2g} °/s is expected at the stated latitude:"
            " the model leaves it out."
        )
        earth = (left_out,) if self.earth_dps and not self.chain.earth_dps else ()
        limits = limits_of(frame, self.simulation, self.band, self.encoder_step_deg)
        above = () if self.response is None else (self.response.sentence(float(self.simulation["K0_v_per_dps"])),)
        held = (
            f"Each value of the output is repeated in {self.rows_per_value} rows: the recorder is faster than the gyro."
            " Of these rows, the first is used."
        )
        repeated = (held,) if self.rows_per_value > 1 else ()
        return (*repeated, *limits, *above, *lines, *earth)


def gyro_problem(
    recording: Recording,
    *,
    model: Mapping[str, Any] | None = None,
    without: Collection[str] = (),
    whole_steps: bool = False,
) -> GyroProblem:
    """Return the problem of a recording with the lab's model, or with another `model` in its place.

    Without a model the output is compared with a straight line in the rate: for a digital gyro, whose unit states its
    scale factor, with the rate itself or its negative; for an analogue one with the best-fitting line (`believed` is
    then false). If there are too few steps to hold some out, they are cut into pieces, unless `whole_steps` is true.

    Raises `UsageError` if the model has a wrong field, if the recording has no scan of encoder and gyro, or if the
    table never turns and there is no model.
    """
    digital = recording.meta.output_unit == "deg/s"
    where = "[simulation] of the model" if model else f"{recording.path}: [simulation]"
    stated = model or recording.meta.simulation
    simulation = None if stated is None else checked_model(stated, where=where, digital=digital)
    temperature_c = _ROOM_C if simulation is None else float(simulation["T0_c"])
    frame = without_noise(at_rest(frame_of(recording, temperature_c=temperature_c, most=most_rows())))
    if simulation is None:
        simulation = _line(recording, frame, digital=digital)
    frame = frame if whole_steps else _cut(frame)
    range_dps = recording.meta.unit.range_dps or float(np.abs(frame.rate_dps).max())
    if range_dps == 0.0:
        raise UsageError(
            f"{recording.path}: the table rests and the unit's range is not known; state range_dps in the import's map"
        )
    facts = recording.meta.bench
    earth_dps = 0.0 if facts.latitude_deg is None else earth_rate_dps(facts.latitude_deg)
    limit_v = float(simulation.get("output_limit_v") or np.inf)
    band, usable = _compared(frame, limit_v)
    K0 = float(simulation["K0_v_per_dps"])
    shared_v = None
    if band is not None:
        shared_v = shared_motion(frame.stretches, 1.0 / frame.interval_s, frame.encoder_deg, frame.volts)
    return GyroProblem(
        frame=frame,
        chain=GyroChain(
            frame, Law.of(simulation), earth_dps, None if shared_v is None else _beyond_wide(frame, shared_v / K0)
        ),
        simulation=simulation,
        range_dps=range_dps,
        without=frozenset(without),
        adc_step_v=2 * facts.adc_range_v / 2**facts.adc_bits if facts.adc_bits else 0.0,
        usable=usable if band is None else usable[band.rows],
        earth_dps=earth_dps,
        band=band,
        response=None if band is None else _response(frame, band, limit_v),
        contrast=None if band is None or shared_v is None else _contrast(frame, band, usable, shared_v),
        encoder_step_deg=360.0 / facts.encoder_counts_per_rev if facts.encoder_counts_per_rev else 0.0,
        believed=stated is not None or digital,
        unit="°/s" if digital else "V",
    )


def _compared(frame: Frame, limit_v: float) -> tuple[Band | None, BoolArray]:
    """Return the band for comparing motion beyond the filters' band, and the usable rows of the frame, (n,).

    If the stretches are too short for the band's low-pass filter, all of their motion is compared.
    """
    if frame.beyond:
        band = band_of(frame.stretches, 1.0 / frame.interval_s, frame.encoder_deg, frame.rate_dps, frame.volts)
        usable = _usable(frame, limit_v, band)
        if np.count_nonzero(usable[band.rows]) >= _FEWEST_IN_BAND:
            return band, usable
    return None, _usable(frame, limit_v, None)


def _response(frame: Frame, band: Band, limit_v: float) -> Response | None:
    """Return gain and phase above a band, from measured rows only."""
    measured = _usable(frame, limit_v, None)
    if frame.filled is not None:
        measured &= ~frame.filled
    return response_of(
        rate_dps=frame.rate_dps,
        volts=frame.volts,
        usable=measured,
        stretches=frame.stretches,
        step=frame.step,
        interval_s=frame.interval_s,
        above_hz=band.stop_hz,
    )


def _contrast(frame: Frame, band: Band, usable: BoolArray, shared_v: FloatArray) -> Contrast | None:
    """Return the difference in sensitivity to the fast motion of a band between the two directions."""
    return contrast_of(
        slow_dps=band.passed(frame.rate_dps),
        fast_v=shared_v - band.passed(shared_v),
        volts=frame.volts,
        usable=usable,
        step=frame.step,
    )


def _beyond_wide(frame: Frame, shared_dps: FloatArray) -> FloatArray:
    """Return the part of a motion shared by encoder and gyro that the encoder's rate does not contain, shape (n,)."""
    sample_rate_hz = 1.0 / frame.interval_s
    smooth = differentiator(sample_rate_hz, *edges_hz(WIDE, sample_rate_hz), 0)
    return shared_dps - filtered_along(frame.stretches, shared_dps, smooth)


def _line(recording: Recording, frame: Frame, *, digital: bool) -> Mapping[str, Any]:
    """Return a straight line in the rate as the model of a gyro that has none stated."""
    usable = np.isfinite(frame.volts) & np.isfinite(frame.rate_dps)
    rate_dps, output = frame.rate_dps[usable], frame.volts[usable]
    if not usable.any() or float(np.ptp(rate_dps)) == 0.0:
        raise UsageError(
            f"{recording.path}: the table never turns, so the recording shows no scale factor;"
            " name a model with --model FILE (K0_v_per_dps, U0_v, T0_c, k_T, k_omega)"
        )
    line = straight_line(rate_dps, output, _ROOM_C)
    return {**line, "K0_v_per_dps": math.copysign(1.0, line["K0_v_per_dps"]), "U0_v": 0.0} if digital else line


def _cut(frame: Frame) -> Frame:
    """Return the frame with enough steps to hold some out."""
    if len(frame.infos) >= _FEWEST_STEPS:
        return frame
    pieces = cut(frame.infos, frame.step, frame.time_s)
    return replace(frame, infos=pieces.infos, step=pieces.step)


def _usable(frame: Frame, limit_v: float, band: Band | None) -> BoolArray:
    """Return the rows made of complete windows of measured values, with a finite output within the limit."""
    usable = np.isfinite(frame.volts) & (np.abs(frame.volts) < limit_v)
    reach = frame.reach + (0 if band is None else band.reach)
    for part in frame.stretches:
        usable[part.start : part.start + reach] = False
        usable[max(part.stop - reach, part.start) : part.stop] = False
    if frame.filled is not None and band is None:  # a low-pass is hardly influenced by a single filled-in sample
        for row in np.flatnonzero(frame.filled).tolist():
            usable[max(row - reach, 0) : row + reach + 1] = False
    return usable
