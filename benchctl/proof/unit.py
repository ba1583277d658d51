"""The gyro and the bench of a trial: their true properties, and the lab's model of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchctl.bench import Bench, Simulation, load_bench
from benchctl_instruments.physics.gyro import GyroParameters, earth_rate_dps

SET_POINTS_C = (
    (23.0, 50.0, 10.0, -30.0, 23.0),
    (23.0, -20.0, 0.0, 40.0, 60.0, 23.0),
    (23.0, 45.0, 65.0, 5.0, -40.0, 20.0),
)
RAMP_C_PER_MIN = 5.0

_LINEAR_S = 1e-6
"""S [rad/(deg/s)] of a gyro whose nonlinearity is far below its noise."""

_BELIEF_K0, _BELIEF_U0 = 2e-5, 2e-5
"""Standard deviation of the lab's K0 (relative) and U0 (of full scale) if nothing has moved."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialUnit:
    """A gyro, its bench and its run. `gyro` is the truth, `belief` the lab's model that the recording states."""

    gyro: GyroParameters
    belief: Simulation
    range_dps: float
    noise_v: float
    sample_rate_hz: float
    encoder_counts_per_rev: int
    latitude_deg: float
    set_points_c: tuple[float, ...]
    start_angle_deg: float
    ripple: float
    air_lag_s: float
    housing_lag_s: float

    @property
    def full_scale_v(self) -> float:
        """The output's change at the rated range."""
        return self.gyro.K0_v_per_dps * self.range_dps

    @property
    def adc_step_v(self) -> float:
        """The step of the digitizer's converter."""
        return load_bench("simulated").digitizer.adc_step_v

    @property
    def earth_dps(self) -> float:
        """The Earth's rate about the table's axis."""
        return earth_rate_dps(self.latitude_deg)

    @property
    def parameters(self) -> dict[str, str]:
        """Parameters of the procedure `diagnostic`."""
        return {
            "set_points_c": ",".join(f"{celsius:g}" for celsius in self.set_points_c),
            "top_rate_dps": f"{self.range_dps:g}",
            "swing_dps": f"{0.3 * self.range_dps:g}",
            "ramp_c_per_min": f"{RAMP_C_PER_MIN:g}",
        }

    def public_bench(self) -> Bench:
        """Return the bench as its recording may describe it, without the simulated physics."""
        simulated = load_bench("simulated")
        public = simulated.model_copy(
            update={
                "name": "sealed bench",
                "unit": simulated.unit.model_copy(update={"serial": "SEALED", "range_dps": self.range_dps}),
                "limits": simulated.limits.model_copy(update={"ramp_c_per_min": RAMP_C_PER_MIN}),
                "site": simulated.site.model_copy(update={"latitude_deg": self.latitude_deg}),
                "digitizer": simulated.digitizer.model_copy(
                    update={
                        "sample_rate_hz": self.sample_rate_hz,
                        "encoder_counts_per_rev": self.encoder_counts_per_rev,
                    }
                ),
                "simulation": self.belief,
                "physics": {},
            }
        )
        return public.read_from("", "")

    def physics(self, seed: int) -> dict[str, Any]:
        """Return `[physics]` of the simulated bench: this unit, without further effects except those of all motion."""
        return {
            "seed": seed,
            "gyro": {name: getattr(self.gyro, name) for name in GyroParameters.__dataclass_fields__},
            "table": {"start_angle_deg": self.start_angle_deg, "ripple": self.ripple},
            "encoder": {"eccentricity_arcsec": 0.0, "ellipticity_arcsec": 0.0},
            "chamber": {
                "ramp_c_per_min": RAMP_C_PER_MIN,
                "air_lag_s": self.air_lag_s,
                "housing_lag_s": self.housing_lag_s,
                "coil_lag_s": 0.1,
            },
        }


def draw_unit(rng: np.random.Generator, *, moved: bool, lacking: frozenset[str], warm: bool) -> TrialUnit:
    """Draw a plausible unit on a plausible bench.

    `moved`: the lab's model is outdated. `lacking` names terms (`k_T`, `k_omega`) that the lab's model must not have;
    `warm`: the scale factor must depend on temperature.
    """
    range_dps = float(rng.choice((100.0, 145.0, 175.0)))
    sample_rate_hz = float(rng.choice((120.0, 125.0)))
    full_scale_v = float(rng.uniform(3.5, 8.0))
    noise_v = full_scale_v * float(np.exp(rng.uniform(np.log(1e-4), np.log(2.5e-4))))
    sine, thermal = rng.random() < 0.7, rng.random() < 0.8
    S = float(rng.uniform(0.003, 0.0046))
    g1, g2 = (float(rng.uniform(*bounds) * rng.choice((-1.0, 1.0))) for bounds in ((6e-5, 3e-4), (5e-7, 2.5e-6)))
    K0 = full_scale_v / range_dps
    gyro = GyroParameters(
        K0_v_per_dps=K0,
        U0_v=float(rng.uniform(-0.03, 0.03)),
        S_rad_per_dps=S if sine and "k_omega" not in lacking else _LINEAR_S,
        T0_c=float(rng.choice((20.0, 23.0, 25.0))),
        g1_per_c=g1 if (thermal or warm) and "k_T" not in lacking else 0.0,
        g2_per_c2=g2 if (thermal or warm) and "k_T" not in lacking else 0.0,
        c1_v_per_c=0.0,
        c2_v_per_c2=0.0,
        arw_deg_per_sqrt_h=noise_v * 60.0 / (K0 * math.sqrt(sample_rate_hz)),
        bias_walk_v_per_sqrt_s=0.0,
        order=0,
        output_limit_v=1.2 * full_scale_v,
    )
    latitude_deg = float(rng.choice((0.0, 41.0, 58.5)))
    return TrialUnit(
        gyro=gyro,
        belief=_belief(rng, gyro, range_dps, noise_v, earth_rate_dps(latitude_deg), moved),
        range_dps=range_dps,
        noise_v=noise_v,
        sample_rate_hz=sample_rate_hz,
        encoder_counts_per_rev=int(rng.choice((2_097_152, 3_600_000, 4_194_304))),
        latitude_deg=latitude_deg,
        set_points_c=SET_POINTS_C[int(rng.integers(len(SET_POINTS_C)))],
        start_angle_deg=float(rng.uniform(0.0, 360.0)),
        ripple=float(rng.uniform(1e-4, 4e-4)),
        air_lag_s=float(rng.uniform(25.0, 50.0)),
        housing_lag_s=float(rng.uniform(100.0, 220.0)),
    )


def _belief(
    rng: np.random.Generator, gyro: GyroParameters, range_dps: float, noise_v: float, earth_dps: float, moved: bool
) -> Simulation:
    """Return the lab's model of a unit: an even polynomial for the interferometer's sine, the Earth's rate in U0."""
    full_scale_v = gyro.K0_v_per_dps * range_dps
    moves = rng.uniform(0.3, 1.0, 5) * rng.choice((-1.0, 1.0), 5)
    K0_error, U0_error = rng.normal(0.0, (_BELIEF_K0, _BELIEF_U0 * full_scale_v))
    S2 = gyro.S_rad_per_dps**2
    k_omega = (-S2 / 6.0, S2**2 / 120.0, -(S2**3) / 5040.0) if gyro.S_rad_per_dps > _LINEAR_S else ()
    k_T = (gyro.g1_per_c, gyro.g2_per_c2) if gyro.g1_per_c else ()
    if moved:
        K0_error, U0_error = 0.02 * moves[0], 2e-3 * full_scale_v * moves[1]
        k_T = tuple(a + step for a, step in zip(k_T, (3e-5 * moves[2], 3e-7 * moves[3]), strict=False))
        k_omega = tuple(b + 6e-3 * moves[4] / range_dps**2 * (i == 0) for i, b in enumerate(k_omega))
    return Simulation(
        K0_v_per_dps=gyro.K0_v_per_dps * (1.0 + float(K0_error)),
        U0_v=gyro.U0_v + gyro.K0_v_per_dps * earth_dps + float(U0_error),
        T0_c=gyro.T0_c,
        k_T=k_T,
        k_omega=k_omega,
        noise_v_rms=noise_v * float(np.exp(rng.uniform(-np.log(2.0), np.log(2.0)))),
        output_limit_v=gyro.output_limit_v,
    )
