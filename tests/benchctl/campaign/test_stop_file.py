"""A wish to stop that lies in the campaign's folder, asked and heeded."""

import json
import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from benchctl.campaign.stop import (
    NotRunningError,
    StoppedError,
    StopRequest,
    ask_by_file,
    forget_stale_stop,
    heed_file,
    is_asked,
)
from benchctl.recordings.campaign_folder import campaign_lock
from benchctl.recordings.campaign_manifest import problems_of_folder, write_manifest
from benchctl.recordings.reader import open_recording
from benchctl.recordings.schema import STOP
from tests.benchctl.cli.processes import started
from tests.slowness import slowness


@pytest.fixture
def stop(tmp_path: Path) -> StopRequest:
    """A request that looks at the folder, and has not looked yet."""
    request = StopRequest()
    heed_file(request, tmp_path)
    return request


def test_who_asks_is_said_where_the_run_heeds_it(tmp_path: Path, stop: StopRequest) -> None:
    lock = campaign_lock(tmp_path)
    lock.acquire("recording")
    ask_by_file(tmp_path, "operator")
    assert is_asked(tmp_path)
    with pytest.raises(StoppedError, match=r"^stopped by the live page \(operator\)$"):
        stop.heed()
    lock.release()


def test_nobody_is_stopped_where_nobody_asks(stop: StopRequest) -> None:
    stop.heed()
    assert stop.reason == ""


def test_a_run_that_has_ended_cannot_be_asked_and_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(NotRunningError, match="it is not running; there is nothing to stop"):
        ask_by_file(tmp_path, "operator")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", [b"", b"[]", b'{"who": "\\u0007"}', b"\xff\xfe", b'{"who": ' + b"[" * 5000])
def test_a_stop_is_heeded_whatever_the_file_says(tmp_path: Path, stop: StopRequest, content: bytes) -> None:
    (tmp_path / STOP).write_bytes(content)
    with pytest.raises(StoppedError, match=r"stopped by the live page \(somebody\)"):
        stop.heed()


def test_a_long_name_is_cut_and_unprintable_letters_are_left_out(tmp_path: Path, stop: StopRequest) -> None:
    (tmp_path / STOP).write_text(json.dumps({"who": "\x1b[31m" + "x" * 5000}))
    with pytest.raises(StoppedError) as caught:
        stop.heed()
    assert "\x1b" not in str(caught.value)
    assert len(str(caught.value)) < 120


def test_what_an_earlier_run_left_behind_is_removed_and_what_came_since_stays(tmp_path: Path) -> None:
    (tmp_path / STOP).write_text('{"who": "operator"}')
    os.utime(tmp_path / STOP, (1.0, 1.0))
    lock = campaign_lock(tmp_path)
    lock.acquire("benchctl run --resume")
    forget_stale_stop(tmp_path)
    assert not is_asked(tmp_path)
    time.sleep(0.05)
    ask_by_file(tmp_path, "operator")
    forget_stale_stop(tmp_path)
    assert is_asked(tmp_path)
    lock.release()


def test_no_manifest_names_a_stop_request(tmp_path: Path) -> None:
    (tmp_path / "journal.jsonl").write_text("")
    (tmp_path / STOP).write_text('{"who": "operator"}')
    write_manifest(tmp_path)
    assert list(json.loads((tmp_path / "manifest.json").read_text())["files"]) == ["journal.jsonl"]
    (tmp_path / STOP).unlink()
    assert list(problems_of_folder(tmp_path)) == []


def test_heeding_looks_at_the_folder_at_most_five_times_a_second(stop: StopRequest) -> None:
    looks = 0

    def asked() -> str:
        nonlocal looks
        looks += 1
        return ""

    stop.watch(asked)
    ends_s = time.monotonic() + 0.5
    while time.monotonic() < ends_s:
        stop.heed()
    assert looks == 3


def test_heeding_costs_less_than_a_microsecond_a_call(stop: StopRequest) -> None:
    assert min(_cost_s(stop.heed) for _ in range(5)) < 1e-6 * slowness()


def _cost_s(call: Callable[[], None], times: int = 100_000) -> float:
    began_s = time.process_time()
    for _ in range(times):
        call()
    return (time.process_time() - began_s) / times


def test_a_run_ends_as_with_ctrl_c_and_nothing_is_left_of_the_request(tmp_path: Path) -> None:
    folder, result = tmp_path / "c", tmp_path / "run.json"
    with started("run", "two_stage", "--bench", "simulated", "--out", folder, "--json", result, "-q") as run:
        wait_for_step(folder)
        ask_by_file(folder, "operator")
        _, errors = run.communicate(timeout=30)
    assert run.returncode == 3
    assert errors.strip() == "benchctl: stopped by the live page (operator)"
    assert json.loads(result.read_text())["status"] == "interrupted"
    with open_recording(folder) as recording:
        assert recording.meta.status == "interrupted"
        assert recording.meta.provenance["reason"] == "stopped by the live page (operator)"
    assert not is_asked(folder)
    assert list(problems_of_folder(folder)) == []


def wait_for_step(folder: Path, timeout_s: float = 30.0) -> None:
    """Wait until a campaign's first step is under way."""
    ends_s = time.monotonic() + timeout_s
    while not any(folder.glob("steps/*.part")):
        assert time.monotonic() < ends_s, "no step has begun"
        time.sleep(0.05)
