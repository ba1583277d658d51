"""Makes a recording in which a given truth is concealed."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.benchctl.diagnosis.foreign import electronics, encoder
from tests.benchctl.diagnosis.foreign.climate import Climate, weather
from tests.benchctl.diagnosis.foreign.felt import felt
from tests.benchctl.diagnosis.foreign.linear import FloatArray
from tests.benchctl.diagnosis.foreign.motion import Motion, move
from tests.benchctl.diagnosis.foreign.outsiders import add_outsiders
from tests.benchctl.diagnosis.foreign.plans import plan
from tests.benchctl.diagnosis.foreign.response import answer
from tests.benchctl.diagnosis.foreign.supply import NOMINAL_V, supply_deviation
from tests.benchctl.diagnosis.foreign.truth import Truth
from tests.benchctl.diagnosis.foreign.unit import Unit, unit_of

COLUMNS = ("time_s", "encoder_deg", "gyro_v", "gyro_temp_c", "chamber_temp_c")
SUPPLY = "supply_v"
"""The sixth column, of recordings in which the supply matters."""

DECIMALS = {"time_s": 6, "encoder_deg": 7, "gyro_v": 6, "gyro_temp_c": 3, "chamber_temp_c": 2, SUPPLY: 4}
"""How the columns are printed; the samples in memory are rounded alike."""

_THERMISTOR_C, _AIR_C = 0.01, 0.02


def make(truth: Truth, seed: int) -> tuple[dict[str, Any], FloatArray]:
    """The description (`recording.json`) and the samples, shape (n, 5) in the order of `COLUMNS`.

    Where the truth holds `supply_sensitivity` there is a sixth column, `SUPPLY`.
    The same truth and seed give the same recording; another truth with the same seed, the same unit, motion and noise
    of the sensors.
    """
    unit_rng, table_rng, gyro_rng, encoder_rng, thermistor_rng = np.random.default_rng((seed, 0xF0E1)).spawn(5)
    bench, effects = truth.where, truth.effects
    unit = unit_of(truth, unit_rng)
    steps = plan(bench.range_dps, truth.set_points)
    moved = move(steps, bench.sample_rate_hz, start_deg=unit.start_deg, cogging=unit.cogging, rng=table_rng)
    climate = weather(steps)
    at = moved.at_samples(bench.sample_rate_hz)
    supply = supply_deviation(moved.time_s, table_rng) if "supply_sensitivity" in effects else None
    output = clean_output(truth, unit, moved, climate, supply)
    output += electronics.lines(effects, at.time_s, gyro_rng.uniform(0.0, 2.0 * np.pi))
    output += electronics.noise(effects, unit.noise_v, at.rate_dps, bench, gyro_rng)
    output = electronics.spiked(effects, electronics.bent(effects, output), gyro_rng)
    output = electronics.converted(effects, output, bench)
    output = electronics.held(effects, output, bench.sample_rate_hz, gyro_rng)
    error = encoder.angle_error(effects, at.angle_deg, encoder_rng.uniform(0.0, 2.0 * np.pi))
    reading = encoder.read(at.angle_deg, error, bench.counts_per_rev, unit.angle_noise_arcsec, encoder_rng)
    columns = {
        "time_s": at.time_s,
        "encoder_deg": reading,
        "gyro_v": output,
        "gyro_temp_c": climate.at(climate.housing_c, at.time_s)
        + thermistor_rng.normal(0.0, _THERMISTOR_C, at.time_s.size),
        "chamber_temp_c": climate.at(climate.air_c, at.time_s) + thermistor_rng.normal(0.0, _AIR_C, at.time_s.size),
    }
    if supply is not None:
        columns[SUPPLY] = NOMINAL_V + moved.cut(supply, bench.sample_rate_hz)
    table = np.column_stack([np.round(values, DECIMALS[name]) for name, values in columns.items()])
    serial = f"DUT-{int(unit_rng.integers(0, 16**6)):06X}"
    return {**bench.described(serial, truth.lacking), "steps": steps}, table


def clean_output(
    truth: Truth, unit: Unit, moved: Motion, climate: Climate, supply_v: FloatArray | None = None
) -> FloatArray:
    """The output at the samples (V) before anything that is noise, converter or data.

    `moved` and `supply_v`, the supply's deviation where it is recorded, are on the fine grid.
    """
    bench, effects = truth.where, truth.effects
    dynamic = bool(electronics.DYNAMIC & effects.keys())
    at = moved.at_samples(bench.sample_rate_hz)
    grid = moved if dynamic else at
    if supply_v is not None and not dynamic:
        supply_v = moved.cut(supply_v, bench.sample_rate_hz)
    feels = felt(effects, grid, climate, supply_v, t0_c=bench.t0_c, earth_dps=unit.earth_dps)
    output = add_outsiders(truth.outsiders, answer(effects, unit, feels), feels, unit)
    return electronics.sampled(effects, output, at.time_s, bench.sample_rate_hz) if dynamic else output
