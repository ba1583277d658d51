"""A recording of a gyro as a problem for the engine: the lab's model, the hypotheses, where a mismatch can live."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from benchctl.diagnosis.gyro.angle_lines import lines_of_angle
from benchctl.diagnosis.gyro.chain import GyroChain, Law
from benchctl.diagnosis.gyro.encoder_noise import rate_variance, steadied_rate
from benchctl.diagnosis.gyro.frame import Frame, frame_of
from benchctl.diagnosis.gyro.frame_subsample import pieces_of, thinned
from benchctl.diagnosis.gyro.limits import at_rest, limits_of
from benchctl.diagnosis.gyro.model import checked_model
from benchctl.diagnosis.gyro.response import Contrast, Response, contrast_of, response_of
from benchctl.diagnosis.gyro.rounding import rounding_between
from benchctl.diagnosis.gyro.subsample import most_rows
from benchctl.diagnosis.keys import tables_of
from benchctl.diagnosis.series import cut
from benchctl.diagnosis.stepped import Stepped
from benchctl.recordings.model import StepInfo
from benchctl.recordings.reader import Recording
from benchctl.signals.binning import hats
from benchctl.signals.free_band import Band, band_of, shared_motion
from benchctl.signals.rate import WIDE, differentiator, edges_hz, filtered_along, half_of
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.effects.effect import DescribedEffect, PhysicalEffect
from benchctl_instruments.physics.effects.kinds import FilterEffect, NoiseEffect
from benchctl_instruments.physics.effects.registry import effects
from benchctl_instruments.physics.gyro import earth_rate_dps
from benchctl_instruments.physics.structure_places import SETPOINT_WAY

_TURN = 360.0
_MANY, _PIECE = 3_000_000, 8
"""Rows from which on a first look at fewer pays; the length of its pieces, in reaches of the filters."""
_ROOM_C = 20.0
"""Reference temperature of a model that nobody stated."""
_FEWEST_IN_BAND = 100
_MOST_LEAD_S = 1.0 / (2.0 * math.pi * 25.0)
"""A part of the acceleration that shifts the output by more than a low-pass of 25 Hz does is no strain of a coil."""
_LEAST_UNCLIPPED = 0.1
_MOST_SCALE = 2.0
"""Neither a part nor a wiring makes a scale factor differ from a stated one by more; a wrong model can."""
_KNOTS, _RIDGE = 12, 1e-9
_FEWEST_STEPS = 12
"""Of fewer steps none can be held out; they are cut into pieces."""


@dataclass(frozen=True, kw_only=True)
class GyroProblem(Stepped):
    """A `benchctl.estimation.problem.Problem`: the gyro's volts from the encoder's motion and the thermistor.

    Its rows are those of the frame, or, of a motion beyond the filters' band, the slow part of some of them (`band`).
    `simulation` is the lab's model under the names of the open recording; `T0_c` its reference temperature. `earth_dps`
    is the Earth's rate about the table's axis, 0 where nobody said where the table stands; `rounding_v` (n,) what the
    steps of a coarse converter have added to the output. `response` and `contrast` are what is compared above the band;
    `rails` are those that its samples were seen to stand at.
    """

    frame: Frame
    chain: GyroChain
    simulation: Mapping[str, Any]
    full_scale: float
    range_dps: float
    without: frozenset[str]
    adc_step_v: float
    usable: BoolArray
    earth_dps: float = 0.0
    rounding_v: FloatArray | None = None
    band: Band | None = None
    response: Response | None = None
    contrast: Contrast | None = None
    encoder_step_deg: float = 0.0
    rails: tuple[PhysicalEffect, ...] = ()
    unit: str = "V"
    believed: bool = True

    @cached_property
    def noises(self) -> frozenset[str]:
        """A random walk of the bias, flicker, noise that grows with the rate."""
        return frozenset({"bias_random_walk", "flicker_noise", "noise_rate_dependent"} - self.without)

    @cached_property
    def regressor_variance(self) -> tuple[FloatArray, FloatArray]:
        """What the encoder's noise adds [V²], and to half a step from row to row; (n,) each."""
        whole, step = rate_variance(self.frame)
        squared = float(self.simulation["K0_v_per_dps"]) ** 2 * (self.band is None)
        return self._kept(squared * whole), self._kept(squared * step)

    @cached_property
    def measured(self) -> FloatArray:
        """The gyro's output [V], shape (n,)."""
        volts = self.slow(self.frame.volts)
        return volts if self.rounding_v is None else volts - self.rounding_v

    @property
    def time_s(self) -> FloatArray:
        """Stamps since the start of the recording [s], shape (n,)."""
        return self._kept(self.frame.time_s)

    @property
    def interval_s(self) -> float:
        """Between two rows [s]."""
        return self.frame.interval_s if self.band is None else self.frame.interval_s * self.band.every

    @property
    def stretches(self) -> tuple[slice, ...]:
        """The parts without gaps."""
        return self.frame.stretches if self.band is None else self.band.kept_stretches

    @property
    def step(self) -> IntArray:
        """Which step a row belongs to, shape (n,)."""
        return self.frame.step if self.band is None else self.frame.step[self.band.rows]

    @property
    def steps(self) -> tuple[StepInfo, ...]:
        """The recording's own steps."""
        return self.frame.infos

    @cached_property
    def recorded(self) -> IntArray:
        """In which of the joined recordings each step is, shape (m,)."""
        begun_s = np.unique(self.frame.origins_s)
        firsts = np.searchsorted(self.frame.step, np.arange(len(self.steps)))
        return np.searchsorted(begun_s, self.frame.time_s[firsts], "right") - 1

    @cached_property
    def baseline_names(self) -> tuple[str, ...]:
        """K0_v_per_dps, U0_v, k_T_1 …, k_omega_2, k_omega_4 …."""
        law = self.chain.law
        temperature = [f"k_T_{i + 1}" for i in range(law.temperature_terms)]
        rate = [f"k_omega_{2 * (i + 1)}" for i in range(law.rate_terms)]
        return ("K0_v_per_dps", "U0_v", *temperature, *rate)

    @cached_property
    def baseline_units(self) -> tuple[str, ...]:
        """Their units."""
        law = self.chain.law
        temperature = [f"°C^-{i + 1}" for i in range(law.temperature_terms)]
        rate = [f"(°/s)^-{2 * (i + 1)}" for i in range(law.rate_terms)]
        return (f"{self.unit}/(°/s)", self.unit, *temperature, *rate)

    @cached_property
    def baseline_start(self) -> FloatArray:
        """The lab's values, shape (p,)."""
        stated = self.simulation
        return np.array([stated["K0_v_per_dps"], stated["U0_v"], *stated["k_T"], *stated["k_omega"]], dtype=np.float64)

    @cached_property
    def baseline_bounds(self) -> Mapping[str, tuple[float, float]]:
        """A stated scale factor is known to within a factor of two; nothing is known of one that was fitted."""
        K0 = float(self.simulation["K0_v_per_dps"])
        low, high = sorted((K0 / _MOST_SCALE, K0 * _MOST_SCALE))
        return {"K0_v_per_dps": (low, high)} if self.believed else {}

    @cached_property
    def circumstances(self) -> Mapping[str, float]:
        """Reference temperature, rated range, the converter's step, where time begins."""
        return {
            "T0_c": self.chain.law.T0_c,
            "range_dps": self.range_dps,
            "adc_step_v": self.adc_step_v,
            "start_s": 0.0,
        }

    @cached_property
    def effects(self) -> Mapping[str, type[DescribedEffect]]:
        """Every effect of the vocabulary that changes a prediction, but for those that are withheld.

        How coarse a converter has become is seen in the samples themselves (`faults`), and what rings above a band, or
        is not in proportion to the momentary rate, only where that is known. An overload, which can stand for a fold,
        is told in static points only. The processor of a digital gyro counts its fringes, if it has any.
        """
        without = {*self.without, "adc_coarse", "overload"}
        if self.unit != "V":
            without.add("fringe_ambiguity")
        if self.band is not None:  # motion above half the sampling rate folds back as lines, of time and of angle
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
        """Where a mismatch can live, each of shape (n,)."""
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

    def predict(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """Volts, shape (n,).

        In a slow band effects of the momentary rate change them by what they do on the average at that slow output:
        what they do beyond it hangs on motion between the samples, which nobody knows.
        """
        volts = self.slow(self.chain.predict(baseline, (*effects, *self.rails)))
        lasting = [effect for effect in effects if not effect.momentary]
        if self.band is None or len(lasting) == len(effects) + len(self.rails):
            return volts
        slow = self.slow(self.chain.predict(baseline, lasting))
        return slow + self._on_the_average(volts - slow, slow)

    def spectral_residual(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """Of gain and phase above the band, and of the two directions', in units of its noise, shape (w,)."""
        parts = [one for one in (self.response, self.contrast) if one is not None]
        if not parts or self.band is None:
            return np.zeros(0)
        volts = self.chain.predict(baseline, (*effects, *self.rails))
        return self.band.noise * np.concatenate([one.residual(volts) for one in parts])

    @cached_property
    def spectral_step(self) -> IntArray:
        """The step of each of its numbers, shape (w,)."""
        of_response = () if self.response is None else (self.response.step,)
        of_contrast = () if self.contrast is None else (self.contrast.steps,)
        return np.concatenate([np.zeros(0, np.int64), *of_response, *of_contrast])

    def forget(self) -> None:
        """What the stages of the chain made last, arrays as long as the recording."""
        self.chain.forget()

    def _on_the_average(self, change: FloatArray, along: FloatArray) -> FloatArray:
        """A change as a broken line along another quantity, by least squares over the usable rows; (n,) each."""
        lines = hats(along, np.linspace(along.min(), along.max(), _KNOTS))
        known = lines[self.usable]
        normal = (known.T @ known).toarray()
        normal += _RIDGE * np.trace(normal) * np.eye(_KNOTS)
        return np.asarray(lines @ np.linalg.solve(normal, known.T @ change[self.usable]))

    def _kept(self, values: FloatArray) -> FloatArray:
        return values if self.band is None else values[self.band.rows]

    def slow(self, values: FloatArray) -> FloatArray:
        """What of the frame's rows (n,) is compared, shape (m,)."""
        return values if self.band is None else self.band.slow(values)

    def otherwise(self) -> Self | None:
        """With the Earth's rate left out, or put in again.

        A gyro feels it; but a recording of a simulation, or one whose stated place is wrong, holds none of it.
        """
        if not self.earth_dps:
            return None
        chain = self.chain
        return replace(
            self, chain=GyroChain(chain.frame, chain.law, 0.0 if chain.earth_dps else self.earth_dps, chain.fast_dps)
        )

    def thinned(self) -> Self | None:
        """Some seconds of many steps, more of a long one, of a recording of very many rows."""
        one_recording = len(set(self.frame.origins_s)) == 1
        if self.frame.rows < _MANY or self.band is not None or not one_recording:
            return None
        reach = half_of(1.0 / self.frame.interval_s)
        frame, rows = thinned(self.frame, pieces_of(self.frame, _PIECE * reach))
        usable = self.usable[rows]
        for part in frame.stretches:  # filters of the output see no further
            usable[part.start : part.start + reach] = False
            usable[max(part.stop - reach, part.start) : part.stop] = False
        chain = GyroChain(frame, self.chain.law, self.chain.earth_dps)
        rounding_v = None if self.rounding_v is None else self.rounding_v[rows]
        return replace(self, frame=frame, chain=chain, usable=usable, rounding_v=rounding_v)

    def unrounded(self, predicted: FloatArray, step_v: float) -> Self:
        """Without what the steps of a coarse converter make of an output that would be `predicted`, shape (n,)."""
        rows, volts = self.usable, self.slow(self.frame.volts)
        rounding = rounding_between(predicted[rows], volts[rows], step_v)
        return replace(self, rounding_v=rounding.mean_v(predicted) - predicted)

    def behind(self, rails: PhysicalEffect, clipped: BoolArray) -> Self:
        """With rails at which the samples `clipped` (n,) stand.

        Of motion that is clipped the filter of `shared_motion` passes only the share that is not (Bussgang, 1952).
        """
        chain, share = self.chain, max(1.0 - float(clipped.mean()), _LEAST_UNCLIPPED)
        fast_dps = None if chain.fast_dps is None else chain.fast_dps / share
        return replace(
            self,
            rails=(rails,),
            chain=GyroChain(chain.frame, chain.law, chain.earth_dps, fast_dps),
            without=self.without | {"saturation", "two_rails"},
        )

    def matters(self, name: str, change: float) -> float:
        """A share of full scale for the bias, of the scale factor for the others, at the edge of what was recorded."""
        if name == "U0_v":
            return abs(change) / self.full_scale
        if name == "K0_v_per_dps":
            return abs(change / float(self.simulation["K0_v_per_dps"]))
        power = int(name.rsplit("_", 1)[1])
        away_c = float(np.abs(self.frame.temp_c - self.chain.law.T0_c).max())
        return abs(change) * (away_c if name.startswith("k_T") else self.range_dps) ** power

    def model_of(self, baseline: FloatArray, effects: Sequence[DescribedEffect], noise: float) -> dict[str, Any]:
        """The tables `simulation` and `effects`; `noise` [V] is that of a sample."""
        values, law = baseline.tolist(), self.chain.law
        split = 2 + law.temperature_terms
        # a model that plays needs a limit: where none is known, one far above what was recorded
        limit = self.simulation.get("output_limit_v") or 2.0 * self.full_scale
        simulation = {
            "K0_v_per_dps": values[0],
            "U0_v": values[1],
            "T0_c": law.T0_c,
            "k_T": values[2:split],
            "k_omega": values[split:],
            "noise_v_rms": noise,
            "output_limit_v": float(limit),
        }
        return {"simulation": simulation, "effects": tables_of(effects)}

    def remarks(self, before: FloatArray, after: FloatArray, heldout: BoolArray) -> tuple[str, ...]:
        """What this recording cannot show, and whether encoder and gyro both see what repeats with the angle."""
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
        above = () if self.response is None else (self.response.says(float(self.simulation["K0_v_per_dps"])),)
        return (*limits, *above, *lines, *earth)


def gyro_problem(
    recording: Recording,
    *,
    model: Mapping[str, Any] | None = None,
    without: Collection[str] = (),
    whole_steps: bool = False,
) -> GyroProblem:
    """The problem of a recording and of the model that its lab believes in, or of another `model` in its place.

    Without a model the output is compared with a straight line in the rate: for a digital gyro, whose unit states its
    scale factor, with the rate itself or its negative; for an analogue one with the line that fits best (`believed` is
    then false). Steps that are too few to hold some out are cut into pieces, but for `whole_steps`.

    Raises `UsageError` where the model has a wrong field, the recording no scan of encoder and gyro, or, without a
    model, the table never turns.
    """
    digital = recording.meta.output_unit == "deg/s"
    where = "[simulation] of the model" if model else f"{recording.path}: [simulation]"
    stated = model or recording.meta.simulation
    simulation = None if stated is None else checked_model(stated, where=where, digital=digital)
    temperature_c = _ROOM_C if simulation is None else float(simulation["T0_c"])
    frame = at_rest(frame_of(recording, temperature_c=temperature_c, most=most_rows()))
    if simulation is None:
        simulation = _line(recording, frame, digital=digital)
    law = Law(
        T0_c=float(simulation["T0_c"]),
        temperature_terms=len(simulation["k_T"]),
        rate_terms=len(simulation["k_omega"]),
    )
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
        chain=GyroChain(frame, law, earth_dps, None if shared_v is None else _beyond_wide(frame, shared_v / K0)),
        simulation=simulation,
        full_scale=abs(K0) * range_dps,
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
    """The band in which a motion that goes beyond the filters is compared, and the usable rows of the frame, (n,).

    Stretches may be too short for a band's low pass: then all of their motion is compared.
    """
    if frame.beyond:
        band = band_of(frame.stretches, 1.0 / frame.interval_s, frame.encoder_deg, frame.rate_dps, frame.volts)
        usable = _usable(frame, limit_v, band)
        if np.count_nonzero(usable[band.rows]) >= _FEWEST_IN_BAND:
            return band, usable
    return None, _usable(frame, limit_v, None)


def _response(frame: Frame, band: Band, limit_v: float) -> Response | None:
    """Gain and phase above a band, of what was measured."""
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
    """How the fast motion of a band is felt in both directions."""
    return contrast_of(
        slow_dps=band.passed(frame.rate_dps),
        fast_v=shared_v - band.passed(shared_v),
        volts=frame.volts,
        usable=usable,
        step=frame.step,
    )


def _beyond_wide(frame: Frame, shared_dps: FloatArray) -> FloatArray:
    """What of a motion that encoder and gyro share the rate of the encoder's angles does not hold, shape (n,)."""
    sample_rate_hz = 1.0 / frame.interval_s
    smooth = differentiator(sample_rate_hz, *edges_hz(WIDE, sample_rate_hz), 0)
    return shared_dps - filtered_along(frame.stretches, shared_dps, smooth)


def _line(recording: Recording, frame: Frame, *, digital: bool) -> Mapping[str, Any]:
    """A straight line in the rate as the model of a gyro of which none is stated."""
    usable = np.isfinite(frame.volts) & np.isfinite(frame.rate_dps)
    rate_dps, output = frame.rate_dps[usable], frame.volts[usable]
    if not usable.any() or float(np.ptp(rate_dps)) == 0.0:
        raise UsageError(
            f"{recording.path}: the table never turns, so the recording shows no scale factor;"
            " name a model with --model FILE (K0_v_per_dps, U0_v, T0_c, k_T, k_omega)"
        )
    slope, offset = np.polyfit(rate_dps, output, 1).tolist()
    return {
        "K0_v_per_dps": math.copysign(1.0, slope) if digital else slope,
        "U0_v": 0.0 if digital else offset,
        "T0_c": _ROOM_C,
        "k_T": [],
        "k_omega": [],
    }


def _cut(frame: Frame) -> Frame:
    """The frame with steps enough to hold some out."""
    if len(frame.infos) >= _FEWEST_STEPS:
        return frame
    pieces = cut(frame.infos, frame.step, frame.time_s)
    return replace(frame, infos=pieces.infos, step=pieces.step)


def _usable(frame: Frame, limit_v: float, band: Band | None) -> BoolArray:
    """Rows that are made of whole windows of what was measured, and whose output is a number within the limit."""
    usable = np.isfinite(frame.volts) & (np.abs(frame.volts) < limit_v)
    reach = half_of(1.0 / frame.interval_s) + (0 if band is None else band.reach)
    for part in frame.stretches:
        usable[part.start : part.start + reach] = False
        usable[max(part.stop - reach, part.start) : part.stop] = False
    if frame.filled is not None and band is None:  # a low pass hardly notices a sample that was filled in
        for row in np.flatnonzero(frame.filled).tolist():
            usable[max(row - reach, 0) : row + reach + 1] = False
    return usable
