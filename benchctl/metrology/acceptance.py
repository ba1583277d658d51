"""Run all tests on a recording and judge each by its limit."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from benchctl.metrology.gyro_tests.across import across_tests
from benchctl.metrology.gyro_tests.at_rest import rest_tests
from benchctl.metrology.gyro_tests.repeatability import repeatability_tests
from benchctl.metrology.gyro_tests.response import response_tests
from benchctl.metrology.gyro_tests.scale_factor import hysteresis_tests, scale_factor_tests
from benchctl.metrology.gyro_tests.small_rates import dead_zone_tests, small_rate_tests
from benchctl.metrology.gyro_tests.temperature import temperature_tests
from benchctl.metrology.gyro_tests.warm_up import ramp_tests, warm_up_tests
from benchctl.metrology.limit_file import Limits
from benchctl.metrology.names import RATE_UNITS, UNITS
from benchctl.metrology.observations import Observations, Settings, observe
from benchctl.metrology.result import Acceptance, Measured, Message, message
from benchctl.metrology.stretches import LEAST_V2
from benchctl.metrology.verdict import Units, column_in, judged, overall, picture_in, rule_of, scaled
from benchctl.recordings.reader import Recording
from benchctl.recordings.stated import expired_of
from benchctl.signals.under_test import under_test
from benchctl_instruments.errors import UsageError

_TESTS: tuple[Callable[[Observations], Iterator[Measured]], ...] = (
    scale_factor_tests,
    repeatability_tests,
    temperature_tests,
    hysteresis_tests,
    small_rate_tests,
    dead_zone_tests,
    rest_tests,
    ramp_tests,
    across_tests,
    response_tests,
    warm_up_tests,
)


def measured_in(recording: Recording, settings: Settings) -> tuple[Measured, ...]:
    """Return the results of all tests, in the order of `UNITS`; those that the recording does not contain are refused.

    Raises
    ------
    UsageError
        If it has no reading, or its output never changes.
    """
    # BLAS sums in another order with another number of threads: a rerun on another machine must give the same digits
    with threadpool_limits(limits=1, user_api="blas"):
        return _measured_in(recording, settings)


def _measured_in(recording: Recording, settings: Settings) -> tuple[Measured, ...]:
    recording = under_test(recording)
    obs = observe(recording, settings)
    if not obs.stretches:
        raise UsageError(
            f"{recording.path}: has no complete step at rest or at a constant rate, which the tests need; "
            "`benchctl run acceptance` records them"
        )
    if obs.points.set_dps.size > 1 and np.ptp(obs.points.output_v) < math.sqrt(LEAST_V2):
        raise UsageError(
            f"{recording.path}: the output is {obs.points.output_v[0]:g} {recording.meta.output_unit} at every rate; "
            "check that the unit is connected and on"
        )
    found = {measured.name: measured for test in _TESTS for measured in test(obs)}
    results = (found[name] for name in UNITS)
    return tuple(results if recording.meta.output_unit == "V" else map(_of_rates, results))


_OF_RATES: Units = {"V": ("deg/s", 1.0), "mV/(deg/s)": (RATE_UNITS["scale_factor"], 1e-3)}


def _of_rates(found: Measured) -> Measured:
    """Return a result with its units, and those of its table and its plot, for an output in deg/s instead of V."""
    unit, factor = _OF_RATES.get(found.unit, (found.unit, 1.0))
    found = scaled(found, factor, unit)
    return replace(
        found,
        table=tuple(column_in(one, _OF_RATES) for one in found.table),
        picture=None if found.picture is None else picture_in(found.picture, _OF_RATES),
    )


def accepted(recording: Recording, limits: Limits) -> Acceptance:
    """Measure a recording and judge it.

    Raises the errors of `measured_in`, and `UsageError` if a limit is for the other kind of output.
    """
    rule = rule_of(limits.guard)
    results = measured_in(recording, limits.settings)
    _refuse_other_output(results, limits)
    every = tuple(judged(measured, limits.limits.get(measured.name), rule) for measured in results)
    return Acceptance(
        verdict=overall(every),
        rule=rule,
        judged=every,
        papers=limits.papers,
        limits_name=limits.path.name,
        limits_sha256=limits.sha256,
        limits_text=limits.text,
        anomalies=tuple(_anomalies(recording)),
        step_digests={info.index: info.digest for info in recording.infos if info.digest},
    )


def _refuse_other_output(results: Sequence[Measured], limits: Limits) -> None:
    for one in results:
        limit, of_rate = limits.limits.get(one.name), RATE_UNITS.get(one.name)
        if limit is not None and of_rate and (limit.unit == of_rate) != (one.unit == of_rate):
            output, unit = ("a rate", of_rate) if one.unit == of_rate else ("in volts", UNITS[one.name])
            raise UsageError(
                f"{limits.path}: limits.{one.name} is in {limit.unit}, but the output of this unit is {output}; state "
                f'the limit with unit = "{unit}"'
            )


def _anomalies(recording: Recording) -> Iterator[Message]:
    """Yield the anomalies of the recording itself, for the report."""
    status = recording.meta.status
    if status not in ("complete", "simulated", "imported"):
        yield message("not_complete", status=status)
    if not recording.digest:
        yield message("no_digest")
    if status == "imported":
        yield message("foreign")
    for info in recording.infos:
        if not info.whole:
            yield message("not_whole", step=info.name)
        if info.gaps:
            yield message("gaps", count=info.gaps, step=info.name)
    for one in expired_of(recording.meta):
        yield message("certificate_expired", role=one.role, model=one.model, date=str(one.calibrated_until))
