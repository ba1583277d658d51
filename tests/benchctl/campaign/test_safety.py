"""A chamber whose air nobody can read any more is at its safe set point all the same, and both are told."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchctl.bench import Bench, load_bench
from benchctl.campaign.opened import open_bench
from benchctl.campaign.runner import Outcome, run_campaign
from benchctl.campaign.safety import bring_to_rest
from benchctl.cli.campaigns import summary
from benchctl.plan import ConstantRate, Plan
from benchctl_instruments.errors import InstrumentError, LinkError
from benchctl_instruments.interfaces import ChamberReading

AIR = "chamber: its set point was read back, its air is not known: "


def bench_with(model: str, *, from_s: float) -> Bench:
    """The simulated bench with that chamber, whose sensor is over range from an instant on."""
    document = load_bench("simulated").model_dump()
    document["chamber"]["model"] = model
    return Bench.model_validate({**document, "faults": [{"on": "chamber", "kind": "over_range", "from_s": from_s}]})


def run(bench: Bench, folder: Path) -> tuple[Outcome, float]:
    """What became of a turn, and the set point that the chamber then truly has."""
    plan = Plan(
        procedure="mine", parameters={}, steps=(ConstantRate(rate_dps=50.0, duration_s=20.0),), calibrates=False
    )
    with open_bench(bench) as opened:
        outcome = run_campaign(plan, opened, folder)
        assert opened.simulated is not None
        return outcome, opened.simulated.world.chamber.setpoint_c()


def test_a_sensor_over_range_ends_the_run_with_the_bench_at_rest_and_the_air_told_apart(tmp_path: Path) -> None:
    outcome, setpoint_c = run(bench_with("watlow_f4", from_s=6.0), tmp_path / "c")
    assert (outcome.status, setpoint_c) == ("aborted", 23.0)
    assert "no valid temperature" in str(outcome.error)
    assert "not known to be at rest" not in str(outcome.error)
    assert (outcome.safe.problems, outcome.safe.chamber_setpoint_c, outcome.safe.confirmed) == ((), 23.0, True)
    (remark,) = outcome.safe.remarks
    assert remark.startswith(AIR)
    assert "no valid temperature" in remark
    assert summary(outcome).splitlines()[-2:] == [
        f"bench: table at {outcome.safe.rate_dps} deg/s, chamber set to 23.0 °C, confirmed by reading back",
        remark,
    ]
    events = [json.loads(line) for line in (outcome.campaign / "journal.jsonl").read_text("utf-8").splitlines()]
    (safe,) = (event for event in events if event["kind"] == "safe")
    assert (safe["problems"], safe["remarks"]) == ([], [remark])


def test_a_chamber_that_reads_well_is_not_remarked_upon(tmp_path: Path) -> None:
    outcome, _ = run(load_bench("simulated"), tmp_path / "c")
    assert (outcome.status, outcome.safe.remarks) == ("complete", ())
    assert len(summary(outcome).splitlines()) == 2


@pytest.mark.parametrize("error", [LinkError("no answer"), ValueError("not in the table of codes")])
def test_a_chamber_that_no_longer_answers_is_not_known_to_be_home(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> ChamberReading:
        raise error

    with open_bench(load_bench("simulated"), wires=False) as opened:
        monkeypatch.setattr(type(opened.chamber), "read", fail)
        safe = bring_to_rest(opened)
    assert (safe.chamber_setpoint_c, safe.confirmed, safe.remarks) == (None, False, ())
    assert len(safe.problems) == 1


def test_a_set_point_that_is_refused_is_no_matter_of_the_air(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise InstrumentError("a program runs; end it on its panel")

    with open_bench(load_bench("simulated"), wires=False) as opened:
        monkeypatch.setattr(type(opened.chamber), "go_to", refuse)
        safe = bring_to_rest(opened)
    assert safe.problems == ("chamber: a program runs; end it on its panel",)
    assert (safe.chamber_setpoint_c, safe.remarks) == (None, ())
