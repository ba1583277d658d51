"""Candidates for the next run: the installed procedures, each with a few parameter sets within the bench's limits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from benchctl.bench import SIMULATED, Bench, Limits, load_bench
from benchctl.campaign.check import problems
from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.plan import Plan
from benchctl.plan.find import installed_procedures
from benchctl.plan.written import as_texts
from benchctl.recordings.model import Meta
from benchctl.toml_file import parse_toml
from benchctl_instruments.errors import UsageError

LONGEST_H = 24.0
"""Longer runs are not proposed."""

_FASTEST_HZ = (0.5, 2.0, 5.0, 10.0, 15.0)
_PASSING = 0.15
"""Maximum frequency, as a share of the sample rate, at which the encoder's rate is reliable."""
_OF_RATE, _OF_ACCELERATION = 0.97, 0.6
_ROUND_DIGITS = 3
_SHORT_SOAK_S, _LONG_SOAK_S = 600.0, 3600.0
_SHORT_REST_S, _LONG_REST_S = 3600.0, 14400.0
_SPAN_C = 35.0
_LEAST_RAMP = 0.5


def bench_of_recording(meta: Meta) -> Bench | None:
    """Return the bench.toml stored in our own recordings; None for a foreign recording."""
    text = meta.provenance.get("bench_toml")
    return parse_toml(text, Bench, "bench.toml of the recording") if text else None


def shown_bench(problem: GyroProblem) -> Bench:
    """Return a bench whose limits are the range of motion and temperature in a recording."""
    frame, usable = problem.frame, problem.usable
    rate, acceleration = (np.abs(problem.coordinates[name][usable]) for name in ("rate", "acceleration"))
    air = frame.chamber_c if np.isfinite(frame.chamber_c).all() else frame.temp_c
    swings = [2 * math.pi * (one.frequency_hz or 0.0) * (one.amplitude_dps or 0.0) for one in frame.infos]
    steepest = 60.0 * float(np.quantile(np.abs(frame.temp_rate_c_per_s), 0.99))
    like = load_bench(SIMULATED)
    limits = Limits(
        rate_dps=max(float(np.quantile(rate, 0.9999)), 1.0),
        acceleration_dps2=max(float(np.quantile(acceleration, 0.999)), *swings, 1.0),
        coldest_c=float(air.min()) - 1.0,
        hottest_c=float(air.max()) + 1.0,
        ramp_c_per_min=max(steepest, _LEAST_RAMP),
    )
    began_c = float(np.clip(air[0], limits.coldest_c, limits.hottest_c))
    return like.model_copy(
        update={
            "limits": limits,
            "safe": like.safe.model_copy(update={"chamber_c": round(began_c, 1)}),
            "unit": like.unit.model_copy(update={"range_dps": problem.range_dps}),
            "digitizer": like.digitizer.model_copy(update={"sample_rate_hz": 1.0 / frame.interval_s}),
        }
    )


def called(given: Mapping[str, Any], plan: Plan) -> str:
    """Return a text for a plan: its procedure and the parameters that differ from the defaults."""
    settings = ", ".join(f"{name} {value}" for name, value in as_texts(given).items())
    return f"`{plan.procedure}`{f' with {settings}' if settings else ''}"


def candidates(bench: Bench) -> Iterator[tuple[Mapping[str, Any], Plan]]:
    """Yield plans without problems in `benchctl check`, each with the parameters that differ from the defaults."""
    sets = dict(_sets(bench))
    for name, procedure in installed_procedures():
        for given in ({}, *sets.get(name, ())):
            try:
                plan = procedure.expand(as_texts(given))
            except UsageError:
                continue  # another author's procedure of the same name has other parameters
            if not problems(plan, bench):
                yield given, plan


def _sets(bench: Bench) -> Iterator[tuple[str, Sequence[Mapping[str, Any]]]]:
    """Yield parameter sets that suit the bench, by procedure."""
    limits = bench.limits
    rate = _round(_OF_RATE * min(limits.rate_dps, bench.unit.range_dps))
    acceleration = _round(_OF_ACCELERATION * limits.acceleration_dps2)
    room = bench.safe.chamber_c
    cold, hot = (
        round(float(np.clip(room + side * _SPAN_C, limits.coldest_c, limits.hottest_c)), 1) for side in (-1, 1)
    )
    highest_hz = _PASSING * bench.digitizer.sample_rate_hz

    def at(hz: float) -> float:
        return _round(min(rate, acceleration / (2 * math.pi * hz)))

    here = {"at_c": room, "soak_s": _SHORT_SOAK_S, "zero_s": 20.0}
    yield (
        "sine_sweep",
        [
            {
                **here,
                "amplitude_dps": at(hz),
                "frequencies_hz": (hz / 5, hz / 2, hz),
                "verify_hz": (_round(0.7 * hz),),
                "run_s": run_s,
            }
            for hz in _FASTEST_HZ
            for run_s in (60.0, 600.0)
            if hz <= highest_hz
        ],
    )
    yield "rate_sweep", [{**here, "top_rate_dps": rate, "rates": 9, "run_s": 10.0, "verify": False}]
    yield (
        "static",
        [{"at_c": room, "soak_s": _SHORT_SOAK_S, "duration_s": lasts_s} for lasts_s in (_LONG_REST_S, _SHORT_REST_S)],
    )
    yield (
        "temperature_sweep",
        [
            {
                "coldest_c": cold,
                "hottest_c": hot,
                "points": 4,
                "soak_s": _LONG_SOAK_S,
                "rate_dps": min(rate, 50.0),
                "rates": 2,
                "return_c_per_min": _round(limits.ramp_c_per_min),
            }
        ],
    )
    every = {
        "top_rate_dps": rate,
        "acceleration_dps2": acceleration,
        "frequencies_hz": tuple(hz for hz in (0.15, 0.5, 1.5, 4.0, 9.0) if hz <= highest_hz),
        "swing_dps": min(rate, 45.0),
    }
    yield (
        "diagnostic",
        [
            {**every, "set_points_c": way, "ramp_c_per_min": _round(share * limits.ramp_c_per_min)}
            for way, share in (
                ((room,), 1.0),
                ((room, hot, cold, room), 1.0),
                ((room, hot, cold, room), 0.25),
                ((room, hot, room, hot, room, cold, room), 1.0),
            )
        ],
    )


def _round(value: float) -> float:
    """Round towards zero to a few digits, so that a limit is not exceeded."""
    if value <= 0.0:
        return value
    unit = 10.0 ** (math.floor(math.log10(value)) - _ROUND_DIGITS + 1)
    return float(f"{math.floor(value / unit + 1e-9) * unit:.{_ROUND_DIGITS}g}")


def two_digits(value: float) -> str:
    """Return a number with two digits, without an exponent."""
    return f"{float(f'{value:.2g}'):.10g}"
