"""The baseline of a gyro's problem, of samples or of static points: the lab's model, and what its changes mean."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from benchctl.diagnosis.gyro.chain import Law
from benchctl.diagnosis.keys import tables_of
from benchctl.diagnosis.stepped import Stepped
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effects.effect import DescribedEffect


@dataclass(frozen=True, kw_only=True)
class GyroBaseline(Stepped):
    """A problem whose baseline is the lab's model with the names of the open recording: `simulation`.

    If it is not `believed`, it is the straight line through the data. `range_dps` is the rated range or, if that is
    unknown, the highest rate; `unit` is that of the output; `without` names effects that are left out.
    """

    simulation: Mapping[str, Any]
    range_dps: float
    without: frozenset[str]
    believed: bool = True
    unit: str = "V"

    @property
    @abstractmethod
    def coil_c(self) -> FloatArray:
        """Temperatures of the gyro [°C]."""

    @cached_property
    def law(self) -> Law:
        """The terms of the model."""
        return Law.of(self.simulation)

    @property
    def full_scale(self) -> float:
        """The line's output at the range."""
        return abs(float(self.simulation["K0_v_per_dps"])) * self.range_dps

    @cached_property
    def baseline_names(self) -> tuple[str, ...]:
        """K0_v_per_dps, U0_v, k_T_1 …, k_omega_2, k_omega_4 …."""
        temperature = [f"k_T_{i + 1}" for i in range(self.law.temperature_terms)]
        return ("K0_v_per_dps", "U0_v", *temperature, *(f"k_omega_{2 * i + 2}" for i in range(self.law.rate_terms)))

    @cached_property
    def baseline_units(self) -> tuple[str, ...]:
        """Units of the parameters."""
        temperature = [f"°C^-{i + 1}" for i in range(self.law.temperature_terms)]
        rate = [f"(°/s)^-{2 * i + 2}" for i in range(self.law.rate_terms)]
        return (f"{self.unit}/(°/s)", self.unit, *temperature, *rate)

    @cached_property
    def baseline_start(self) -> FloatArray:
        """The model's values, shape (p,)."""
        stated = self.simulation
        return np.array([stated["K0_v_per_dps"], stated["U0_v"], *stated["k_T"], *stated["k_omega"]], dtype=np.float64)

    def matters(self, name: str, change: float) -> float:
        """Return a change of the bias as a share of full scale, others as a share of scale factor at the edge."""
        if name == "U0_v":
            return abs(change) / self.full_scale
        if name == "K0_v_per_dps":
            return abs(change / float(self.simulation["K0_v_per_dps"]))
        power = int(name.rsplit("_", 1)[1])
        away_c = float(np.abs(self.coil_c - self.law.T0_c).max())
        return abs(change) * (away_c if name.startswith("k_T") else self.range_dps) ** power

    def model_of(self, baseline: FloatArray, effects: Sequence[DescribedEffect], noise: float) -> dict[str, Any]:
        """Return the tables `simulation` and `effects`; `noise` is the scatter of a sample, or of a static point."""
        values, split = baseline.tolist(), 2 + self.law.temperature_terms
        simulation = {
            "K0_v_per_dps": values[0],
            "U0_v": values[1],
            "T0_c": self.law.T0_c,
            "k_T": values[2:split],
            "k_omega": values[split:],
            "noise_v_rms": noise,
            # a simulation needs a limit: if none is known, one far above the recorded output is used
            "output_limit_v": float(self.simulation.get("output_limit_v") or 2.0 * self.full_scale),
        }
        return {"simulation": simulation, "effects": tables_of(effects)}
