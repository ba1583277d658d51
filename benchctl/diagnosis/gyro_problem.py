"""A recording of a gyro as a problem for the engine: the lab's model, the hypotheses, where a mismatch can live."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.frame import Frame, frame_of
from benchctl.diagnosis.gyro_chain import GyroChain, Law
from benchctl.diagnosis.motion import HALF
from benchctl.recordings.reader import Recording
from instruments.errors import UsageError
from instruments.physics.effects.effect import DescribedEffect
from instruments.physics.effects.kinds import NoiseEffect
from instruments.physics.effects.registry import effects

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

_TURN = 360.0


@dataclass(frozen=True, kw_only=True)
class GyroProblem:
    """A `benchctl.diagnosis.problem.Problem`: the gyro's volts from the encoder's motion and the thermistor.

    `simulation` is the lab's model under the names of the open recording; `T0_c` its reference temperature.
    """

    frame: Frame
    chain: GyroChain
    simulation: Mapping[str, Any]
    full_scale: float
    range_dps: float
    without: frozenset[str]
    adc_step_v: float
    usable: BoolArray
    unit: str = "V"

    @property
    def measured(self) -> FloatArray:
        """The gyro's output [V], shape (n,)."""
        return self.frame.volts

    @property
    def time_s(self) -> FloatArray:
        """Stamps since the start of the recording [s], shape (n,)."""
        return self.frame.time_s

    @property
    def interval_s(self) -> float:
        """Between two scans [s]."""
        return self.frame.interval_s

    @property
    def stretches(self) -> tuple[slice, ...]:
        """The parts without gaps."""
        return self.frame.stretches

    @property
    def step(self) -> IntArray:
        """Which step a row belongs to, shape (n,)."""
        return self.frame.step

    @property
    def step_names(self) -> tuple[str, ...]:
        """Names of the steps."""
        return tuple(info.name for info in self.frame.infos)

    @property
    def step_kinds(self) -> tuple[str, ...]:
        """Kinds of the steps."""
        return tuple(info.kind for info in self.frame.infos)

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
        return ("V/(°/s)", "V", *temperature, *rate)

    @cached_property
    def baseline_start(self) -> FloatArray:
        """The lab's values, shape (p,)."""
        stated = self.simulation
        return np.array([stated["K0_v_per_dps"], stated["U0_v"], *stated["k_T"], *stated["k_omega"]], dtype=np.float64)

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
        """Every effect of the vocabulary that changes a prediction, but for those that are withheld."""
        return {
            name: kind
            for name, kind in effects().items()
            if name not in self.without and not issubclass(kind, NoiseEffect)
        }

    @cached_property
    def coordinates(self) -> Mapping[str, FloatArray]:
        """Where a mismatch can live, each of shape (n,)."""
        frame = self.frame
        return {
            "time": frame.time_s,
            "rate": frame.rate_dps,
            "abs_rate": np.abs(frame.rate_dps),
            "rate_sign": np.sign(np.where(np.abs(frame.rate_dps) < 0.5, 0.0, frame.rate_dps)),
            "acceleration": frame.acceleration_dps2,
            "angle": np.mod(frame.angle_deg, _TURN),
            "gyro_temp": frame.temp_c,
            "gyro_temp_rate": frame.temp_rate_c_per_s,
            "chamber_temp": frame.chamber_c,
            "output": frame.volts,
            "step": frame.step.astype(np.float64),
        }

    def predict(self, baseline: FloatArray, effects: Sequence[Any]) -> FloatArray:
        """Volts, shape (n,)."""
        return self.chain.predict(baseline, effects)


def gyro_problem(
    recording: Recording, *, model: Mapping[str, Any] | None = None, without: Collection[str] = ()
) -> GyroProblem:
    """The problem of a recording and of the model that its lab believes in, or of another `model` in its place.

    Raises `UsageError` where there is no model, or no scan of encoder, gyro and thermistor.
    """
    frame = frame_of(recording)
    simulation = model or recording.meta.simulation
    if simulation is None:
        raise UsageError(
            f"{recording.path}: says of no model what the gyro should have put out;"
            " name one with --model FILE (K0_v_per_dps, U0_v, T0_c, k_T, k_omega)"
        )
    range_dps = recording.meta.unit.range_dps or float(np.abs(frame.rate_dps).max())
    law = Law(
        T0_c=float(simulation["T0_c"]),
        temperature_terms=len(simulation["k_T"]),
        rate_terms=len(simulation["k_omega"]),
    )
    facts = recording.meta.bench
    return GyroProblem(
        frame=frame,
        chain=GyroChain(frame, law),
        simulation=simulation,
        full_scale=abs(float(simulation["K0_v_per_dps"])) * range_dps,
        range_dps=range_dps,
        without=frozenset(without),
        adc_step_v=2 * facts.adc_range_v / 2**facts.adc_bits if facts.adc_bits else 0.0,
        usable=_usable(frame, float(simulation.get("output_limit_v") or np.inf)),
    )


def _usable(frame: Frame, limit_v: float) -> BoolArray:
    """Rows whose rate is made of whole windows of angles, and whose output is a number within the limit."""
    usable = np.isfinite(frame.volts) & (np.abs(frame.volts) < limit_v)
    for part in frame.stretches:
        usable[part.start : part.start + HALF] = False
        usable[max(part.stop - HALF, part.start) : part.stop] = False
    return usable
