"""What the lab tests of its own: with benchctl's contract for effects and its pytest fixtures."""

import pytest
from example_lab.vibration_rectification import VibrationRectification

from benchctl import api
from benchctl_instruments.physics.effect_contract import check_effect

FROSTLINE = pytest.mark.benchctl_bench(chamber={"model": "frostline_fl20"})


def test_the_effect_keeps_its_contract():
    check_effect(VibrationRectification)


@FROSTLINE
def test_the_chamber_follows_its_set_point(benchctl_bench, benchctl_clock):
    chamber = benchctl_bench.chamber
    assert chamber.identify().manufacturer == "Frostline"
    chamber.set_limits(-40.0, 85.0)
    chamber.go_to(30.0)
    chamber.start()
    benchctl_clock.sleep(3600.0)
    assert chamber.read().temperature_c == pytest.approx(30.0, abs=0.1)
    with pytest.raises(api.UsageError, match=r"ERR outside -40\.00 to 85\.00"):
        chamber.go_to(90.0)


@FROSTLINE
@pytest.mark.benchctl_fault(on="chamber", kind="silence", from_s=60.0, times=1)
def test_the_procedure_survives_a_silent_chamber(benchctl_run, benchctl_faults):
    outcome = benchctl_run("rectification", soak_s=120, run_s=2)
    assert outcome.status == "complete"
    assert [fault.where for fault in benchctl_faults.fired] == ["chamber"]
