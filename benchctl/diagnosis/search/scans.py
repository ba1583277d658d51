"""Places proposed by scans of the residual, for effects with far too many possible places to test one by one.

A line can have any of 10⁵ frequencies, a grating any of 10⁵ numbers of lines, a fold any rate, a limit any output. Each
scan scores all of them with one transform of the residual. The best become ordinary probes that state how many places
they were selected from.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from benchctl.diagnosis.gyro.points import PointsProblem
from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.search.probes import Probe, probe_at
from benchctl.diagnosis.search.pull import Pull, pull_of
from benchctl.diagnosis.search.scan_converter import converter_places
from benchctl.diagnosis.search.scan_ends import fold_places, limit_places, onset_places, rail_places
from benchctl.diagnosis.search.scan_lines import line_places
from benchctl.diagnosis.search.scan_mains import mains_places, swing_hz
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.fit import Fit
from benchctl.estimation.noise import Whitener
from benchctl.side_by_side import shared_out

SCANNED = frozenset(
    {
        "mains_pickup",
        "adc_nonlinearity",
        "encoder_interpolation",
        "fringe_ambiguity",
        "overload",
        "saturation",
        "two_rails",
    }
)
"""The effects for which places are proposed."""
_COUNT = 3


def proposals(problem: PartProblem, whitener: Whitener, fitted: Fit) -> list[Probe]:
    """Return the best places of every scanned effect that is not in the fitted model, up to three per effect.

    By chance, a probe's gain less twice the logarithm of its `places` exceeds 14 less than once in a thousand cases.
    """
    known = {effect.identifier for effect in fitted.point.effects}
    wanted = sorted(SCANNED - known)
    if not any(name in problem.effects for name in wanted):
        return []
    pull = pull_of(problem, whitener, fitted)
    if not pull.rows.any() or fitted.deviation <= 0.0:
        return []
    tried = [name for name in wanted if name in problem.effects]
    found = shared_out(lambda name: list(_places(problem, pull, name)), tried)
    return [
        replace(probe_at(problem, problem.effects[name], place, places=count), pulled=pulled)
        for name, places in zip(tried, found, strict=True)
        for place, count, pulled in places
    ]


def _places(problem: PartProblem, pull: Pull, name: str) -> Iterator[tuple[Mapping[str, float], float, float]]:
    """Yield the best places of an effect: its parameters by name and the number of places it was selected from.

    The third value is the promised gain, for effects without a size, else 0.
    """
    parameters = problem.effects[name].parameters
    if name == "mains_pickup":
        kinds = np.unique(problem.step_kinds, return_inverse=True)[1][problem.step]
        lowest = parameters["frequency_hz"].low
        for place in mains_places(
            pull, problem.clock_s, problem.interval_s, kinds, lowest, _COUNT, swinging_hz(problem)
        ):
            yield {"frequency_hz": place.value}, place.places, 0.0
    elif name == "adc_nonlinearity":
        for place in converter_places(pull, pull.fitted.predicted, parameters["period_v"].low, _COUNT):
            yield {"period_v": place.value}, place.places, 0.0
    elif name == "fringe_ambiguity":  # has no size: after a wrong fit its own column gives no information
        for place in fold_places(pull, problem.coordinates["rate"], float(problem.baseline_start[0]), _COUNT):
            yield {"fold_dps": place.value}, place.places, place.gain
    elif name == "overload":
        for place in onset_places(pull, problem.coordinates["rate"], pull.fitted.predicted, _COUNT):
            yield {"onset_dps": place.value}, place.places, 0.0
    elif name == "two_rails":
        if isinstance(problem, PointsProblem):
            if problem.end is not None and (rails := problem.end.rails()) is not None:
                yield {"lower_v": rails.lower_v, "upper_v": rails.upper_v}, rails.places, 0.0
            return
        for pair in rail_places(pull, pull.fitted.predicted, _COUNT):
            yield {"lower_v": pair.lower_v, "upper_v": pair.upper_v}, pair.places, 0.0
    elif name == "saturation":
        for place in limit_places(pull, pull.fitted.predicted, _COUNT):
            yield {"limit_v": place.value}, place.places, 0.0
    elif isinstance(problem, GyroProblem):
        for place in line_places(problem, pull, int(parameters["lines_per_rev"].high), _COUNT):
            yield {"lines_per_rev": place.value}, place.places, 0.0


def swinging_hz(problem: PartProblem) -> float:
    """Return the single frequency [Hz] at which the table of a recording swings; 0 if there is none."""
    rate = problem.coordinates.get("rate")
    return 0.0 if rate is None else swing_hz(rate, problem.clock_s, problem.interval_s)
