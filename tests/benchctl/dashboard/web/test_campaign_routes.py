"""What is asked of campaigns over HTTP: one that is over, and one that this process is writing."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from benchctl.recordings.schema import STOP
from tests.benchctl.dashboard.web.conftest import OVER, RUNNING, write_campaign
from tests.benchctl.dashboard.web.serving import Served
from tests.benchctl.recordings.made import step

UNKNOWN = "0123456789abcdef"


@pytest.fixture
def over(served: Served) -> str:
    """The path of the campaign that is over."""
    return f"/api/campaigns/{served.key_of(OVER)}"


@pytest.fixture
def running(served: Served) -> str:
    """The path of the campaign that is being written."""
    return f"/api/campaigns/{served.key_of(RUNNING)}"


def test_the_list_tells_the_campaign_that_runs_from_the_one_that_is_over(served: Served) -> None:
    with served.client(served.view_token) as client:
        listed = client.get("/api/campaigns").json()["campaigns"]
    statuses = {campaign["name"]: campaign["status"] for campaign in listed}  # other tests write campaigns as well
    assert (statuses[OVER], statuses[RUNNING]) == ("complete", "running")
    assert all(campaign["steps_whole"] == 2 for campaign in listed)


def test_one_campaign_says_what_the_list_says_and_more(served: Served, over: str) -> None:
    with served.client() as client:
        listed = client.get("/api/campaigns").json()["campaigns"]
        said = client.get(over).json()
    entry = next(campaign for campaign in listed if campaign["name"] == OVER)
    assert {name: said[name] for name in entry} == entry
    assert [(one["name"], one["whole"], one["samples"]) for one in said["steps"]] == [
        ("rate +1", True, 200),
        ("rate +2", True, 200),
    ]
    assert "gyro_v" in [channel["name"] for channel in said["channels"]]


def test_a_channel_comes_sample_by_sample_where_they_fit(served: Served, over: str) -> None:
    wanted: dict[str, str | float] = {"channel": "gyro_v", "from_s": 100.0, "to_s": 102.0, "pixels": 200}
    with served.client() as client:
        said = client.get(f"{over}/series", params=wanted).json()
    assert (said["exact"], said["complete"], said["samples"]) == (True, True, 200)
    assert np.array_equal(said["low"], step(1)["gyro_v"])


@pytest.mark.parametrize(
    "changed",
    [
        {"channel": "no_such_channel"},
        {"channel": "../gyro_v"},
        {"channel": ""},
        {"channel": None},
        {"from_s": "nan"},
        {"to_s": "inf"},
        {"to_s": "1e400"},
        {"to_s": "0"},
        {"pixels": 0},
        {"pixels": 4001},
        {"pixels": "many"},
        {"pixels": 10**30},
    ],
)
def test_a_window_that_is_none_is_refused_in_a_line(served: Served, over: str, changed: dict[str, object]) -> None:
    asked = {"channel": "gyro_v", "from_s": 0, "to_s": 1000, "pixels": 100} | changed
    wanted = {name: str(value) for name, value in asked.items() if value is not None}
    with served.client() as client:
        refused = client.get(f"{over}/series", params=wanted)
    assert refused.status_code == 422
    assert "\n" not in refused.json()["error"]


def test_events_go_on_where_they_ended(served: Served, over: str) -> None:
    with served.client() as client:
        first = client.get(f"{over}/events").json()
        assert first["events"]
        rest = client.get(f"{over}/events", params={"after": first["next"]}).json()
        assert rest == {"events": [], "next": first["next"]}
        assert client.get(f"{over}/events", params={"after": -1}).status_code == 422


@pytest.mark.parametrize("what", ["", "/series?channel=gyro_v&from_s=0&to_s=1", "/events", "/documents/diagnosis"])
@pytest.mark.parametrize(
    "key",
    [
        UNKNOWN,
        UNKNOWN[:-1],
        f"{UNKNOWN}0",
        UNKNOWN.upper(),
        "..",
        "%2e%2e",
        "..%2f..%2fetc%2fpasswd",
        "%00",
        "over",
        "*",
        "0123456789abcde%0a",
        "０123456789abcde",
    ],
)
def test_an_id_that_the_list_does_not_have_leads_nowhere(served: Served, key: str, what: str) -> None:
    with served.client() as client:
        answer = client.get(f"/api/campaigns/{key}{what}", follow_redirects=False)
    assert answer.status_code in (404, 422, 307)
    assert answer.status_code != 307 or key in ("..", "%2e%2e")


@pytest.mark.parametrize("kind", ["", "manifest", "%2e%2e%2fjournal.jsonl", "diagnosis.json", "acceptance%00"])
@pytest.mark.parametrize("rest", ["", "/report"])
def test_a_document_is_one_of_three_and_no_file(served: Served, over: str, kind: str, rest: str) -> None:
    with served.client() as client:
        assert client.get(f"{over}/documents/{kind}{rest}").status_code in (404, 422)


@pytest.mark.parametrize("kind", ["calibration", "diagnosis", "acceptance"])
def test_a_document_that_was_never_made_is_said_to_be_missing(served: Served, over: str, kind: str) -> None:
    with served.client() as client:
        for rest in ("", "/report"):
            missing = client.get(f"{over}/documents/{kind}{rest}")
            assert (missing.status_code, missing.json()) == (404, {"error": f"this campaign has no {kind}"})


def test_an_explanation_is_that_of_the_command_line_and_an_unknown_term_is_said_to_be_one(served: Served) -> None:
    with served.client() as client:
        assert client.get("/api/explain/thermal_lag").json()["name"] == "thermal_lag"
        unknown = client.get("/api/explain/thermal_lagg")
    assert unknown.status_code == 404
    assert "thermal_lag" in unknown.json()["error"]


def test_the_operator_stops_the_run_that_is_named_and_only_with_its_name(
    served: Served, running: str, campaigns: Path
) -> None:
    request = campaigns / RUNNING / STOP
    with served.browser() as (client, csrf):
        headers = {"X-CSRF": csrf}
        wrong = client.post(f"{running}/stop", json={"confirm": OVER}, headers=headers)
        assert (wrong.status_code, request.exists()) == (422, False)
        asked = client.post(f"{running}/stop", json={"confirm": RUNNING}, headers=headers)
        assert (asked.status_code, asked.json()) == (202, {"asked": True})
        assert json.loads(request.read_text())["who"] == "operator"
        client.post(f"{running}/stop", json={"confirm": RUNNING, "who": "A. Ohm"}, headers=headers)
    assert json.loads(request.read_text())["who"] == "A. Ohm"
    request.unlink()


def test_a_viewer_stops_nothing_by_whatever_way(served: Served, running: str, campaigns: Path) -> None:
    order = {"confirm": RUNNING}
    with served.client(served.view_token) as client:
        assert client.post(f"{running}/stop", json=order).status_code == 403
    with served.browser(served.view_token) as (client, csrf):
        assert client.post(f"{running}/stop", json=order, headers={"X-CSRF": csrf}).status_code == 403
    assert not (campaigns / RUNNING / STOP).exists()


def test_nobody_stops_a_run_from_another_site_or_without_the_sessions_word(
    served: Served, running: str, campaigns: Path
) -> None:
    order = {"confirm": RUNNING}
    with served.browser() as (client, csrf):
        assert client.post(f"{running}/stop", json=order).status_code == 403
        assert client.post(f"{running}/stop", json=order, headers={"X-CSRF": csrf[:-1]}).status_code == 403
        foreign = {"X-CSRF": csrf, "Origin": "http://evil.example"}
        assert client.post(f"{running}/stop", json=order, headers=foreign).status_code == 403
    with served.client(None) as client:
        assert client.post(f"{running}/stop", json=order).status_code == 401
    assert not (campaigns / RUNNING / STOP).exists()


@pytest.mark.parametrize(
    ("body", "kind"),
    [
        (b"", "application/json"),
        (b"{}", "application/json"),
        (b"[]", "application/json"),
        (b'{"confirm": 7}', "application/json"),
        (b'{"confirm": "running", "more": 1}', "application/json"),
        (b'{"confirm": "running"', "application/json"),
        (b"[" * 8000, "application/json"),
        (b"\xff\xfe", "application/json"),
        (b"confirm=running", "application/x-www-form-urlencoded"),
        (b'{"confirm": "running"}', "text/plain"),
    ],
    ids=lambda value: repr(value[:20]),
)
def test_an_order_that_is_none_stops_nothing(
    served: Served, running: str, campaigns: Path, body: bytes, kind: str
) -> None:
    with served.client(**{"Content-Type": kind}) as client:
        refused = client.post(f"{running}/stop", content=body)
    assert refused.status_code in (400, 415, 422)
    assert list(refused.json()) == ["error"]
    assert not (campaigns / RUNNING / STOP).exists()


def test_a_campaign_that_is_over_cannot_be_stopped(served: Served, over: str, campaigns: Path) -> None:
    with served.client() as client:
        refused = client.post(f"{over}/stop", json={"confirm": OVER})
    assert (refused.status_code, list(refused.json())) == (409, ["error"])
    assert not (campaigns / OVER / STOP).exists()


def test_a_campaign_that_is_gone_or_spoilt_meanwhile_is_refused_in_a_line(served: Served, campaigns: Path) -> None:
    writer = write_campaign(campaigns / "spoilt")
    recording = writer.finish("complete")
    path = f"/api/campaigns/{served.key_of('spoilt')}"
    with served.client() as client:
        assert client.get(path).status_code == 200
        recording.write_bytes(os.urandom(recording.stat().st_size))
        spoilt = [client.get(f"{path}/series?channel=gyro_v&from_s=0&to_s=1"), client.get(path)]
        recording.unlink()
        gone = [client.get(f"{path}/series?channel=gyro_v&from_s=0&to_s=1"), client.get(path)]
    for answer in (*spoilt, *gone):
        assert answer.status_code in (404, 422), answer.text
        assert "\n" not in answer.json()["error"]
