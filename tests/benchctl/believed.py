"""The simulated bench's gyro as its datasheet would have it, for models with one thing more."""

from __future__ import annotations

BELIEVED = """[simulation]
K0_v_per_dps = 0.05
U0_v = 0.012
T0_c = 20.0
k_T = [-1.315e-4, 2.066e-6]
k_omega = [-3.375e-6, 3.417e-12]
noise_v_rms = 0.0006
output_limit_v = 11.0
"""
NO_ENCODER_ERRORS = """
[physics.encoder]
eccentricity_arcsec = 0.0
ellipticity_arcsec = 0.0
"""
