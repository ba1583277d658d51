"""What a recording of a gyro cannot show: reported in sentences, without guesses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from benchctl.diagnosis.gyro.frame import Frame
from benchctl.diagnosis.gyro.subsample import AIR, PIECE, THERMISTOR
from benchctl.signals.free_band import Band
from benchctl.signals.rate import NARROW, edges_hz

_TURNING_DPS = 0.05
"""Rate below which a table counts as at rest: the encoder's noise makes hundredths of a degree per second."""

_REST_S = 1.0
_SPAN_C = 2.0
_FASTEST_C_PER_S = 5e-4
_TURN_DEG = 360.0
_SECTOR_DEG = 5.0


def at_rest(frame: Frame) -> Frame:
    """Return the frame with zero rate if the table never turns; otherwise noise would be taken for a rate."""
    if _turns(frame):
        return frame
    still = np.zeros_like(frame.rate_dps)
    return replace(frame, rate_dps=still, acceleration_dps2=still)


def limits_of(
    frame: Frame, simulation: Mapping[str, Any], band: Band | None, encoder_step_deg: float
) -> tuple[str, ...]:
    """Return the sentences; `encoder_step_deg` is the encoder's step, 0 if it is unknown."""
    return (*_limits(frame, simulation, band), *_coarse(frame, simulation, encoder_step_deg))


def not_all_rows(frame: Frame) -> tuple[str, ...]:
    """Return a sentence if rows of the recording were left out, else an empty tuple."""
    if not frame.left_out:
        return ()
    return (
        f"The recording has {frame.rows + frame.left_out:,} rows: {frame.rows:,} of them were looked at, pieces of"
        f" {PIECE * frame.interval_s:.3g} s at most, drawn by lot from all steps; the thermometer throughout.",
    )


def _coarse(frame: Frame, simulation: Mapping[str, Any], step_deg: float) -> Iterator[str]:
    """Yield a sentence if the steps of an encoder can look like physical effects.

    At a steady rate they beat with the samples. The first harmonic of the staircase has the amplitude step/π; a beat at
    the edge f of the filter's pass band makes it a rate of 2·step·f, a slower one less.
    """
    passing_hz, _ = edges_hz(NARROW, 1.0 / frame.interval_s)
    error_v = 2.0 * step_deg * passing_hz * abs(float(simulation["K0_v_per_dps"]))
    noise_v = float(simulation.get("noise_v_rms") or math.inf)
    if _turns(frame) and error_v > noise_v:
        yield (
            f"The encoder's steps of {3600.0 * step_deg:.3g}″ beat with the samples at steady rates: the rate is then"
            f" wrong by up to {error_v / noise_v:.2g} times the noise of the output. What repeats"
            " finely with the angle or the output, or is left in the acceleration, may be no more than that."
        )


def _turns(frame: Frame) -> bool:
    return bool(np.quantile(np.abs(frame.rate_dps), 0.995) > _TURNING_DPS)


def _seen_deg(frame: Frame) -> float:
    """Return the part of the turn over which the encoder was read [deg]."""
    sectors = np.unique(np.mod(frame.encoder_deg, _TURN_DEG) // _SECTOR_DEG)
    return float(sectors.size * _SECTOR_DEG)


def _limits(frame: Frame, simulation: Mapping[str, Any], band: Band | None) -> Iterator[str]:
    yield from not_all_rows(frame)
    if not _turns(frame):
        yield (
            "The table never turns in this recording: of the scale factor, of all that grows with the rate, of time and"
            " of the encoder nothing is observable; the result concerns the bias only."
        )
    elif float(np.sum(np.abs(frame.rate_dps) < _TURNING_DPS)) * frame.interval_s < _REST_S:
        yield "The table never rests in this recording: the bias is known from its motion alone."
    if _turns(frame) and (deg := _seen_deg(frame)) < _TURN_DEG:
        yield (
            f"The encoder was read over {deg:.0f}° of its turn only, so its own scale is not tested: if its degrees"
            " are too small or too large by a share, that looks exactly like a K0 that is wrong by the same share."
        )
    if not frame.thermistor:
        yield (
            f"No temperature was recorded: the gyro is taken to be at T0 = {float(simulation['T0_c']):g} °C throughout,"
            " and no effect of temperature is observable."
        )
    else:
        if frame.thermistor == AIR:
            yield (
                f"The gyro's thermistor ({THERMISTOR}) was not recorded: the chamber's air is used instead, and the"
                " housing's own slowness would look like a thermal lag."
            )
        span = float(np.ptp(frame.temp_c))
        steepest = float(np.quantile(np.abs(frame.temp_rate_c_per_s), 0.99))
        if span < _SPAN_C:
            yield (
                f"The gyro's temperature changes by {span:.2g} °C in all: effects of temperature are not observable"
                " in this recording, or only if they are large."
            )
        elif steepest < _FASTEST_C_PER_S:
            yield (
                "The gyro's temperature is steady wherever samples were taken: what depends on how fast it changes is"
                " not observable in this recording."
            )
    if frame.known_hz is not None:
        yield (
            f"The encoder's rate is noisy: beyond {frame.known_hz:.3g} Hz it has little in common with the gyro. Faster"
            " motion is left out of the model"
            + (
                ", and a wandering bias is not looked for, because what remains of that noise is as slow."
                if frame.noisy_within
                else "."
            )
        )
    if band is not None:
        yield (
            f"The motion goes beyond the band in which an encoder's angles make a rate: gyro and model are compared"
            f" row by row up to {band.up_to_hz:.3g} Hz, and residuals are those of that band; single spikes, a held"
            " output and lines above it are not looked for, and what is not in proportion to the momentary rate (the"
            " sine law, a dead zone, an asymmetry, a converter's errors) only by what it does on the average at each"
            " output and to the shaking in both directions."
        )
