"""A fleet made up for the tests of its reports: fits, diagnoses and acceptances of like units, one of them odd."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchctl.history.series import Figure
from benchctl.reports.fleet_facts import Fleet, Member
from benchctl.reports.fleet_stated import FleetVerb, FoundEffect, FoundParameter, Stated

ODD = 3
"""The number of the unit that stands apart in K0, fails its bias and is the only one with an effect of its own."""


def fleet(count: int = 24, *, verb: FleetVerb = "fit", failed: tuple[str, ...] = (), left: int = 0) -> Fleet:
    """So many units; every second one has a thermal lag; `failed` are names of recordings that could not be read."""
    rng = np.random.default_rng(1)
    members = [member(number, rng) for number in range(count)]
    broken = replace(members[0], state="failed", serial="", model="", stated={}, reports={})
    for name in failed:
        members.append(
            replace(broken, recording=f"/lab/{name}.h5", name=name, reason=f"/lab/{name}.h5: is no <HDF5> file")
        )
    return Fleet(verb=verb, members=tuple(members), left=left)


def member(number: int, rng: np.random.Generator) -> Member:
    """One unit."""
    odd = number == ODD
    K0 = 0.05 + 2e-5 * rng.normal() + (5e-4 if odd else 0.0)
    bias = 0.3 * rng.normal() + (4.0 if odd else 0.0)
    verdict = "FAIL" if odd else "PASS"
    delay = "INCONCLUSIVE" if number % 5 == 0 else "PASS"
    effects = [effect("thermal_lag", "tau_s", 300.0 + 40.0 * rng.normal(), "s")] * (number % 2 == 0)
    effects += [
        effect("scale_asymmetry", "percent", -0.7, "%"),
        FoundEffect(effect="dropouts", explains=None, parameters=()),
    ] * odd
    return Member(
        recording=f"/lab/SN-{number:02d}.h5",
        name=f"SN-{number:02d}",
        serial=f"SN-{number:02d}",
        model="VG910Q",
        state="kept" if number == 1 else "done",
        reason="",
        stated={
            "fit": Stated(
                figures=(
                    Figure(name="K0_v_per_dps", unit="V/(deg/s)", value=K0, uncertainty=1e-6),
                    Figure(name="U0_v", unit="V", value=0.012 + 1e-4 * rng.normal(), uncertainty=1e-4),
                    Figure(name="error_percent.joint", unit="%", value=0.02 + 0.002 * rng.random()),
                )
            ),
            "diagnose": Stated(verdict="missing-physics" if effects else "consistent", effects=tuple(effects)),
            "accept": Stated(
                verdict=verdict,
                figures=(
                    Figure(name="bias", unit="deg/h", value=bias, uncertainty=0.1, verdict=verdict, low=-2.0, high=2.0),
                    Figure(name="threshold", unit="deg/s", value=0.002, bound="at most", verdict="PASS"),
                ),
                tests=(
                    ("bias", verdict),
                    ("threshold", "PASS"),
                    ("delay", delay),
                ),
            ),
        },
        reports={"fit": f"/lab/SN-{number:02d}.fit/report.html"},
    )


def effect(name: str, parameter: str, value: float, unit: str) -> FoundEffect:
    """A finding with one parameter."""
    told = FoundParameter(name=parameter, value=value, low=value * 0.9, high=value * 1.1, unit=unit)
    return FoundEffect(effect=name, explains=0.8, parameters=(told,))
