"""The gyro and the table as they are, which is not quite as the file says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.benchctl.diagnosis.foreign.motion import Cogging
from tests.benchctl.diagnosis.foreign.truth import Truth

_EARTH_DPH = 15.041


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """The true coefficients, in the units of `Bench`; `earth_dps` is the Earth's rate about the table's axis."""

    k0_v_per_dps: float
    u0_v: float
    k_t: tuple[float, ...]
    k_omega: tuple[float, ...]
    noise_v: float
    angle_noise_arcsec: float
    earth_dps: float
    start_deg: float
    cogging: Cogging


def nominal(truth: Truth) -> Unit:
    """The unit that the file describes, with the terms that its simulation lacks taken out."""
    bench = truth.where
    return Unit(
        k0_v_per_dps=bench.k0_v_per_dps,
        u0_v=bench.u0_v,
        k_t=() if "k_T" in truth.lacking else bench.k_t,
        k_omega=() if "k_omega" in truth.lacking else bench.k_omega,
        noise_v=bench.noise_v,
        angle_noise_arcsec=bench.angle_noise_arcsec,
        earth_dps=0.0,
        start_deg=0.0,
        cogging=Cogging(order=36, size=4e-4, phase_rad=0.0),
    )


def unit_of(truth: Truth, rng: np.random.Generator) -> Unit:
    """A unit of the kind that the file describes.

    K0 and U0 are always a little off; `coefficients_moved` moves everything. The noise is what the file claims times
    0.6 to 2; half of the labs have the Earth's rate in their recordings.
    """
    bench, kind = truth.where, nominal(truth)
    k0 = kind.k0_v_per_dps * (1.0 + rng.normal(0.0, 1e-3))
    u0 = kind.u0_v + rng.normal(0.0, 5e-4)
    k_t, k_omega = kind.k_t, kind.k_omega
    moves = rng.uniform(0.3, 1.0, 6) * rng.choice((-1.0, 1.0), 6)
    if truth.coefficients_moved:
        k0 *= 1.0 + moves[0] * 2e-2
        u0 += moves[1] * 2e-3 * bench.full_scale_v
        k_t = tuple(a + m * s for a, m, s in zip(k_t, moves[2:4], (3e-5, 3e-7), strict=False))
        k_omega = tuple(
            b + m * s / bench.range_dps ** (2 * k + 2)
            for k, (b, m, s) in enumerate(zip(k_omega, moves[4:6], (6e-3, 3e-3), strict=False))
        )
    earth = _EARTH_DPH / 3600.0 * np.sin(np.deg2rad(bench.latitude_deg)) * rng.integers(0, 2)
    return Unit(
        k0_v_per_dps=float(k0),
        u0_v=float(u0),
        k_t=k_t,
        k_omega=k_omega,
        noise_v=bench.noise_v * float(np.exp(rng.uniform(np.log(0.6), np.log(2.0)))),
        angle_noise_arcsec=bench.angle_noise_arcsec * rng.uniform(0.8, 1.25),
        earth_dps=float(earth),
        start_deg=rng.uniform(0.0, 360.0),
        cogging=Cogging(order=36, size=4e-4 * rng.uniform(0.8, 1.25), phase_rad=rng.uniform(0.0, 2.0 * np.pi)),
    )
