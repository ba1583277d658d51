"""The plan and the bench of a recording, from its provenance alone."""

import json
from pathlib import Path
from typing import Any

import pytest

from benchctl.bench import Bench, bench_of_text, template
from benchctl.campaign.again import bench_again, plan_again
from benchctl.campaign.opened import another_day, world_settings
from benchctl.recordings.model import BenchFacts, Meta, Status, Unit
from benchctl_instruments.errors import UsageError

REAL = (
    template()
    .replace("simulated = true", "simulated = false")
    .replace('# address = "tcp://192.168.1.53:9888"', 'address = "tcp://192.168.1.53:9888"')
    .replace('# address = "tcp://192.168.1.60:502"', 'address = "tcp://192.168.1.60:502"')
    .replace('# address = "tcp://192.168.1.70:502"', 'address = "tcp://192.168.1.70:502"')
)


def _bench(text: str = template()) -> Bench:
    return bench_of_text(text, "bench.toml")


def _meta(
    bench: Bench | None = None,
    *,
    procedure: str = "rate_sweep",
    parameters: Any = None,
    status: Status = "complete",
    serial: str = "SIM-0001",
) -> Meta:
    stands = bench or _bench()
    told = {
        "procedure": procedure,
        "parameters": json.dumps(parameters or {}),
        "bench_toml": stands.text,
        "bench_physics": json.dumps(stands.physics) if stands.simulated else "",
        "bench_effects": "{}" if stands.simulated else "",
    }
    unit = Unit(serial=serial, range_dps=175.0)
    provenance = told if procedure else {}
    return Meta(status=status, unit=unit, bench=BenchFacts(sample_rate_hz=500.0), provenance=provenance)


def test_the_parameters_of_every_type_come_back_as_they_were() -> None:
    told = {"rates": 3, "run_s": 12.5, "verify": False, "at_c": 25}
    plan = plan_again(_meta(parameters=told), "first")
    assert {name: plan.parameters[name] for name in told} == {"rates": 3, "run_s": 12.5, "verify": False, "at_c": 25.0}
    assert type(plan.parameters["at_c"]) is float
    assert plan.parameters["zero_s"] == 60.0  # not recorded: the default of today
    assert "def rate_sweep" in plan.source


def test_a_tuple_comes_back_from_its_list() -> None:
    plan = plan_again(_meta(procedure="sine_sweep", parameters={"frequencies_hz": [0.1, 0.25]}), "first")
    assert plan.parameters["frequencies_hz"] == (0.1, 0.25)


@pytest.mark.parametrize(
    ("parameters", "says"),
    [
        ({"rate": 3}, "has no parameter 'rate': did you mean rates"),
        ({"rates": "three"}, "parameter rates: expected an integer, got 'three'"),
        ({"rates": {"a": 1}}, "parameter rates: expected an integer"),
        ([1, 2], "expected a table"),
    ],
)
def test_parameters_that_the_procedure_cannot_have_are_refused(parameters: Any, says: str) -> None:
    with pytest.raises(UsageError, match=r"^--again first: ") as refused:
        plan_again(_meta(parameters=parameters), "first")
    assert says in str(refused.value)


def test_a_file_that_a_recording_names_is_not_run(tmp_path: Path) -> None:
    script = tmp_path / "turns.py"
    script.write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\n")
    with pytest.raises(UsageError, match="is not installed, and the source that the recording keeps is not run"):
        plan_again(_meta(procedure=str(script)), "first")
    assert not (tmp_path / "ran").exists()


def test_an_import_names_no_procedure() -> None:
    with pytest.raises(UsageError, match="--again first: it was imported, and so names no procedure to run again"):
        plan_again(_meta(procedure="", status="imported"), "first")
    with pytest.raises(UsageError, match="it does not say how it was made"):
        plan_again(_meta(procedure=""), "first")


def test_the_recorded_bench_has_another_days_noise_and_the_same_encoder() -> None:
    first = _bench().with_seed(5)
    again = bench_again(_meta(first), "first", None, None)
    before, now = world_settings(first), world_settings(again)
    assert (before.seed, now.seed) == (5, 6)
    assert now.encoder == before.encoder
    assert world_settings(first.with_seed(6)).encoder != before.encoder


def test_a_named_seed_is_the_seed() -> None:
    assert bench_again(_meta(), "first", None, 9).physics["seed"] == 9
    assert bench_again(_meta(), "first", _bench(), 9).physics == {"seed": 9}


def test_a_rerun_of_a_rerun_by_the_bench_file_has_noise_that_neither_had() -> None:
    first = _bench()
    second = another_day(first, 1)
    third = bench_again(_meta(second), "second", first, None)
    assert third.physics["seed"] == 3
    assert world_settings(third).encoder == world_settings(first).encoder


def test_the_named_bench_keeps_what_its_file_says_of_the_physics() -> None:
    text = template().replace("seed = 1\n", "seed = 1\n[physics.encoder]\neccentricity_phase_deg = 12.0\n")
    again = world_settings(bench_again(_meta(), "first", _bench(text), None))
    assert again.encoder.eccentricity_phase_deg == 12.0
    assert again.encoder.ellipticity_phase_deg == world_settings(_bench()).encoder.ellipticity_phase_deg


def test_a_real_bench_must_be_named() -> None:
    with pytest.raises(UsageError, match="--again first: was not made on a simulated bench; name the bench"):
        bench_again(_meta(_bench(REAL)), "first", None, None)
    assert bench_again(_meta(_bench(REAL)), "first", _bench(REAL), None) == _bench(REAL)


def test_another_unit_is_refused() -> None:
    with pytest.raises(UsageError, match="it is of unit G-17, and simulated bench has unit SIM-0001; mount the same"):
        bench_again(_meta(serial="G-17"), "first", _bench(), None)
