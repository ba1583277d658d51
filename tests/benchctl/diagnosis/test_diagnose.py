"""The engine against recordings of a generator that shares no code with it, and against the open examples."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from benchctl.diagnosis import diagnose
from benchctl.recordings.reader import open_recording
from instruments.errors import UsageError
from tests.benchctl.diagnosis.foreign import Truth, draw, make, to_recording
from tests.benchctl.diagnosis.moving import KINDS, write_moving
from tests.shared import SHARED, needs_shared


def _recorded(truth: Truth, seed: int):  # type: ignore[no-untyped-def]
    return to_recording(*make(truth, seed))


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_where_nothing_is_missing_no_effect_is_found() -> None:
    found = diagnose(_recorded(draw("null", 3), 3))
    assert found.findings == ()
    assert found.verdict in ("consistent", "recalibrate")
    assert found.fit.heldout_after_v == pytest.approx(found.fit.noise_v, rel=0.03)
    assert any(one.smallest is not None for one in found.not_found)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_thermal_lag_is_found_alone_and_with_its_time_constant() -> None:
    plain = draw("null", 4)
    truth = Truth(kind="single", bench=plain.bench, plan=plain.plan, effects={"thermal_lag": {"tau_s": 240.0}})
    found = diagnose(_recorded(truth, 4))
    assert [one.effect for one in found.findings] == ["thermal_lag"]
    tau = found.findings[0].parameters["tau_s"]
    assert tau.value == pytest.approx(240.0, rel=0.1)
    assert found.fit.heldout_after_v < found.fit.heldout_before_v


def test_of_a_short_recording_it_finds_what_is_missing_and_nothing_where_nothing_is(tmp_path: Path) -> None:
    for squared_v, effects in ((0.0, []), (2e-6, ["rate_squared"])):
        path = write_moving(tmp_path / f"{squared_v}.h5", squared_v=squared_v, kinds=KINDS * 2)
        with open_recording(path) as recording:
            found = diagnose(recording)
        assert [one.effect for one in found.findings] == effects
        assert found.verdict == ("missing-physics" if effects else "consistent")


def test_a_part_whose_channels_were_not_recorded_is_refused_in_one_line(tmp_path: Path) -> None:
    with (
        open_recording(write_moving(tmp_path / "gyro.h5")) as recording,
        pytest.raises(UsageError, match="no step has the channels encoder_deg, torque_nm together"),
    ):
        diagnose(recording, part="drive")


@pytest.mark.slow
@pytest.mark.timeout(600)
@needs_shared("checks")
def test_the_three_open_examples_come_out_right() -> None:
    command = [sys.executable, "-m", "benchctl", "diagnose", "{rec}", "--json", "{out}", "--quiet"]
    check = subprocess.run(
        [sys.executable, str(SHARED / "checks" / "diagnosis.py"), *command], capture_output=True, text=True, check=False
    )
    assert check.returncode == 0, check.stdout
    assert json.dumps(check.stdout).count("right") == 3
