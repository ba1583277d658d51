"""One campaign in detail: plan, steps, channels, limits, provenance."""

import json
import math
from pathlib import Path

import pytest

from benchctl.bench import load_bench
from benchctl.campaign.opened import open_bench
from benchctl.campaign.runner import run_campaign
from benchctl.dashboard.data.details import details_of
from benchctl.plan import ConstantRate, Plan, Soak, Static
from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.writer import write_recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.recordings import made
from tests.benchctl.recordings.open_folder import write_open

STEPS = (Soak(setpoint_c=25.0, hold_s=600.0), Static(duration_s=5.0), ConstantRate(rate_dps=20.0, duration_s=5.0))


def test_a_campaign_that_was_run_tells_its_plan_and_what_became_of_it(tmp_path: Path) -> None:
    plan = Plan(procedure="mine", parameters={}, steps=STEPS, calibrates=False, source="source")
    with open_bench(load_bench("simulated"), wires=False) as opened:
        run_campaign(plan, opened, tmp_path / "c")
    for place in (tmp_path / "c", tmp_path / "c" / "recording.h5"):  # the journal of the folder, and that in the file
        found = details_of(place)
        assert [(step["index"], step["label"], step["kind"]) for step in found["plan"]] == [
            (1, "soak at +25", "soak"),
            (2, "static", "static"),
            (3, "rate +20", "constant_rate"),
        ]
        assert [step["setpoint_c"] for step in found["plan"]] == [25.0, 25.0, 25.0]
        assert found["plan"][1]["t_start_s"] == found["plan"][0]["t_end_s"]
    assert [(step["name"], step["whole"]) for step in found["steps"]] == [
        ("soak at +25", True),
        ("static at +25", True),
        ("rate +20 at +25", True),
    ]
    assert found["steps"][2]["rate_dps"] == 20.0
    assert found["t_end_s"] == found["steps"][2]["t_end_s"]
    assert [limit["quantity"] for limit in found["limits"]] == ["rate_dps", "acceleration_dps2", "air_c"]
    assert set(found["plan"][0]) == {"index", "label", "kind", "t_start_s", "t_end_s", "setpoint_c", "began_s"}
    began_s = [step["began_s"] for step in found["plan"]]
    assert began_s == sorted(began_s)
    assert all(began <= step["t_start_s"] for began, step in zip(began_s, found["steps"], strict=True))
    assert "journal" not in found["provenance"]
    assert found["provenance"]["procedure"] == "mine"
    assert len(found["digest"]) == 64
    json.dumps(found, allow_nan=False)


def test_channels_have_units_and_axes_and_say_what_they_are(tmp_path: Path) -> None:
    channels = {one["name"]: one for one in details_of(made.recording(tmp_path))["channels"]}
    assert list(channels)[:3] == ["rate_dps", "air_c", "gyro_c"]
    assert "the angle's change over 0.05 s" in channels["rate_dps"]["says"]
    assert channels["gyro_v"] == {"name": "gyro_v", "unit": "V", "says": "output of the gyro", "axis": "time_s"}
    assert channels["air_c"]["axis"] == channels["poll_chamber_temp_c"]["axis"] == "poll_time_s"
    assert "time_s" not in channels


def test_a_recording_of_before_plans_were_noted_has_none(tmp_path: Path) -> None:
    found = details_of(made.recording(tmp_path))
    assert (found["plan"], found["limits"]) == ([], [])
    assert found["provenance"] == {"procedure": "two_stage", "operator": "Ö. Ångström"}


def test_a_set_point_that_nobody_knows_is_none_and_a_unit_of_an_import_is_its_own(tmp_path: Path) -> None:
    path = tmp_path / "theirs.h5"
    step = made.step(1, chamber_setpoint_c=math.nan)
    extra = {"gyro_output_unit": "deg/s", "channel_units": {"gyro_temp_c": "K"}}
    write_recording(path, made.meta(status="imported", extra=extra), [step])
    found = details_of(path)
    assert found["steps"][0]["setpoint_c"] is None
    units = {one["name"]: one["unit"] for one in found["channels"]}
    assert (units["gyro_v"], units["gyro_temp_c"]) == ("deg/s", "K")


def test_an_open_recording_is_told_like_any_other(tmp_path: Path) -> None:
    found = details_of(write_open(tmp_path / "open"))
    assert [step["name"] for step in found["steps"]] == ["rest", "turn", "rows from 31"]
    assert {"chamber_temp_c", "air_c", "rate_dps"} <= {one["name"] for one in found["channels"]}


def test_a_campaign_that_runs_is_told_as_far_as_it_has_come(tmp_path: Path) -> None:
    writer = CampaignWriter(tmp_path / "c", made.meta(status="running"))
    step = writer.begin_step(made.info(1), made.STREAMED)
    step.append(made.streamed(3.0, 50))
    step.flush()
    (part,) = details_of(tmp_path / "c")["steps"]
    assert (part["whole"], part["samples"], part["t_end_s"]) == (False, 50, 3.49)
    writer.release()


@pytest.mark.parametrize("content", [b"", b"text", None])
def test_what_cannot_be_read_is_one_line(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "bad.h5"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UsageError) as told:
        details_of(path)
    assert "\n" not in str(told.value)
