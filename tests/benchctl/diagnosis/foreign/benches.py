"""The three benches of the other lab: gyro, table, digitizer, and the simulation that each lab's file claims."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """A bench and the calibration of its gyro; `angle_noise_arcsec` is white noise of the encoder, rms per sample."""

    range_dps: float
    sample_rate_hz: float
    counts_per_rev: int
    adc_bits: int
    adc_range_v: float
    latitude_deg: float
    k0_v_per_dps: float
    u0_v: float
    t0_c: float
    k_t: tuple[float, ...]
    k_omega: tuple[float, ...]
    noise_v: float
    limit_v: float
    angle_noise_arcsec: float

    @property
    def lsb_v(self) -> float:
        """The converter's step (V)."""
        return 2.0 * self.adc_range_v / 2.0**self.adc_bits

    @property
    def full_scale_v(self) -> float:
        """The output's change at the rated range (V), by the file's simulation at T0."""
        rate = self.range_dps
        shape = 1.0 + sum((b * rate ** (2 * k + 2) for k, b in enumerate(self.k_omega)), start=0.0)
        return float(self.k0_v_per_dps * rate * shape)

    def described(self, serial: str, lacking: frozenset[str]) -> dict[str, Any]:
        """What `recording.json` says of the bench, with the terms of the simulation that are `lacking` left empty."""
        return {
            "format": "open-recording/1",
            "unit": {"serial": serial, "range_dps": self.range_dps},
            "bench": {
                "sample_rate_hz": self.sample_rate_hz,
                "encoder_counts_per_rev": self.counts_per_rev,
                "adc_bits": self.adc_bits,
                "adc_range_v": self.adc_range_v,
                "latitude_deg": self.latitude_deg,
            },
            "simulation": {
                "K0_v_per_dps": self.k0_v_per_dps,
                "U0_v": self.u0_v,
                "T0_c": self.t0_c,
                "k_T": [] if "k_T" in lacking else list(self.k_t),
                "k_omega": [] if "k_omega" in lacking else list(self.k_omega),
                "noise_v_rms": self.noise_v,
                "output_limit_v": self.limit_v,
            },
        }


BENCHES = (
    Bench(
        range_dps=145.0,
        sample_rate_hz=125.0,
        counts_per_rev=4194304,
        adc_bits=18,
        adc_range_v=5.0,
        latitude_deg=58.5,
        k0_v_per_dps=0.016,
        u0_v=0.012,
        t0_c=23.0,
        k_t=(1.315e-4, -2.066e-6),
        k_omega=(3.02e-6, 5.89e-11),
        noise_v=5e-4,
        limit_v=4.0,
        angle_noise_arcsec=0.55,
    ),
    Bench(
        range_dps=100.0,
        sample_rate_hz=100.0,
        counts_per_rev=8388608,
        adc_bits=18,
        adc_range_v=10.0,
        latitude_deg=41.0,
        k0_v_per_dps=0.022,
        u0_v=0.031,
        t0_c=20.0,
        k_t=(2.2e-4, -1e-6),
        k_omega=(-4e-6, 0.0),
        noise_v=8e-4,
        limit_v=4.2,
        angle_noise_arcsec=0.37,
    ),
    Bench(
        range_dps=240.0,
        sample_rate_hz=100.0,
        counts_per_rev=3600000,
        adc_bits=16,
        adc_range_v=5.0,
        latitude_deg=52.2,
        k0_v_per_dps=0.0095,
        u0_v=-0.006,
        t0_c=25.0,
        k_t=(-9e-5, 1.1e-6),
        k_omega=(-1.9e-6, 1.2e-11),
        noise_v=3.5e-4,
        limit_v=4.5,
        angle_noise_arcsec=0.6,
    ),
)
