"""Runs started over HTTP: by whom, of what, one at a time, and living on without the server."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from benchctl.bench import template
from benchctl.campaign.page_operator import OpenQuestion, answer_question, open_question
from benchctl.recordings.reader import open_recording
from tests.benchctl.campaign.by_hand import events
from tests.benchctl.cli.processes import simulated_servers, started
from tests.benchctl.dashboard.web.serving import Served, serving

pytestmark = pytest.mark.timeout(300)

DOOR = "close the chamber's door"
RELEASED = """
[released.incoming]
title = "Incoming inspection"
procedure = "incoming.py"
parameters = { rest_s = 20.0 }
[released.hot]
procedure = "static"
parameters = { at_c = 150.0 }
"""
PROCEDURE = f"""
from benchctl.plan import Ask, Static, procedure

@procedure()
def incoming(rest_s: float = 5.0):
    '''Rest with the door closed.'''
    yield Ask(says="{DOOR}")
    yield Static(duration_s=rest_s)
"""
ORDER = {"procedure": "incoming", "serial": "SN-17"}
START = ORDER | {"who": "A. Ohm", "order": "0123456789abcdef"}
QUEUE = "queue-simulated-bench.jsonl"
ANSWER = {"question": "x", "answer": "done", "who": "A. Ohm"}
CHANGES: list[tuple[str, dict[str, Any]]] = [
    ("/api/check", ORDER),
    ("/api/start", START),
    ("/api/queue", START),
    ("/api/queue/0123456789abcdef/remove", {"who": "A. Ohm"}),
    ("/api/queue/go_on", {"who": "A. Ohm", "hold": 1, "resume": False}),
    ("/api/queue/go_on", {"who": "A. Ohm", "hold": 1, "resume": True}),
    ("/api/campaigns/0123456789abcdef/stop", {"confirm": "x"}),
    ("/api/campaigns/0123456789abcdef/sign", {"who": "A. Ohm", "verdict": "PASS"}),
    ("/api/campaigns/0123456789abcdef/answer", ANSWER),
]


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a bench that releases two procedures, one of which it cannot run."""
    return lab_in(tmp_path_factory.mktemp("lab"))


def lab_in(folder: Path) -> Path:
    """Write the lab into a folder: one server at a time starts runs of its bench."""
    (folder / "results").mkdir()
    (folder / "incoming.py").write_text(PROCEDURE)
    (folder / "bench.toml").write_text(template() + RELEASED, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def station(lab: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A server before the lab's results, that may start what the lab has released."""
    with serving(lab / "results", tmp_path_factory.mktemp("cache"), "--bench", lab / "bench.toml") as server:
        yield server


def question_in(folder: Path) -> OpenQuestion:
    """The question of a run, once it is asked."""
    ends_s = time.monotonic() + 60.0
    while time.monotonic() < ends_s:
        if (question := open_question(folder)) is not None:
            return question
        time.sleep(0.1)
    raise AssertionError(f"{folder}: nothing is asked")


def test_what_is_released_is_listed_for_all_who_may_look(station: Served) -> None:
    with station.client(station.view_token) as client:
        said = client.get("/api/released").json()
    assert said["bench"] == "simulated bench"
    incoming, hot = said["procedures"]
    assert (incoming["title"], incoming["says"], incoming["steps"]) == (
        "Incoming inspection",
        "Rest with the door closed.",
        2,
    )
    assert incoming["questions"] == 1
    assert incoming["bench_time_s"] > 20.0
    assert (hot["title"], hot["bench_time_s"]) == ("hot", None)


def test_a_session_says_whether_it_may_start(station: Served, served: Served) -> None:
    for server, token, may in ((station, "token", True), (station, "view_token", False), (served, "token", False)):
        with server.browser(getattr(server, token)) as (client, _):
            assert client.get("/api/session").json()["may_start"] is may


@pytest.mark.parametrize(("path", "body"), CHANGES)
def test_who_only_looks_has_no_word_or_comes_from_elsewhere_changes_nothing(
    station: Served, lab: Path, path: str, body: dict[str, Any]
) -> None:
    before = sorted((lab / "results").iterdir())
    with station.client(None) as client:
        assert client.post(path, json=body).status_code == 401
    with station.client(station.view_token) as client:
        refused = client.post(path, json=body)
        assert (refused.status_code, refused.json()["error"].partition(";")[0]) == (403, "this token only looks")
    with station.browser() as (client, csrf):
        for headers in ({}, {"X-CSRF": "x"}, {"X-CSRF": csrf, "Origin": "http://evil.example"}):
            assert client.post(path, json=body, headers=headers).status_code == 403
        assert client.get(path).status_code == (200 if path == "/api/queue" else 405)
    assert sorted((lab / "results").iterdir()) == before


@pytest.mark.parametrize("path", ["/api/check", "/api/start", "/api/queue"])
@pytest.mark.parametrize(
    ("changed", "status"),
    [
        ({"procedure": "two_stage"}, 404),
        ({"procedure": "../incoming.py"}, 404),
        ({"serial": ""}, 422),
        ({"serial": "SN-17\n"}, 422),
        ({"serial": "SN\x00-17"}, 422),
        ({"serial": " "}, 422),
        ({"serial": "9" * 61}, 422),
        ({"serial": 17}, 422),
        ({"bench": "simulated"}, 422),
        ({"parameters": {"rest_s": 1}}, 422),
        ({"order": "../../x"}, 422),
    ],
)
def test_an_order_of_anything_else_is_refused(
    station: Served, lab: Path, path: str, changed: dict[str, Any], status: int
) -> None:
    before = sorted((lab / "results").iterdir())
    order = (ORDER if path == "/api/check" else START) | changed
    with station.client() as client:
        refused = client.post(path, json=order)
    assert (refused.status_code, list(refused.json())) == (status, ["error"])
    assert sorted((lab / "results").iterdir()) == before


@pytest.mark.slow
def test_a_check_says_what_benchctl_check_says_and_what_it_refuses_is_not_started(station: Served, lab: Path) -> None:
    with station.client() as client:
        ready = client.post("/api/check", json=ORDER | {"serial": "-x --help"}, timeout=60).json()
        hot = client.post("/api/check", json=ORDER | {"procedure": "hot"}, timeout=60).json()
        refused = client.post("/api/start", json=START | {"procedure": "hot"}, timeout=60)
    assert (ready["ready"], ready["problems"], ready["questions"], ready["steps"]) == (True, [], [DOOR], 2)
    assert "LabJack T7 470012345" in ready["instruments"]
    (problem,) = hot["problems"]
    assert not hot["ready"]
    assert problem.startswith("step 1: soak at +150: goes to 150 °C, the bench's limits are -55 to 85 °C")
    assert (refused.status_code, refused.json()["error"]) == (409, f"procedure static, {problem}")
    assert [path.name for path in (lab / "results").iterdir()] == [QUEUE]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="niceness and SIGKILL are things of POSIX")
def test_a_start_that_is_sent_again_gives_one_run_which_outlives_the_server(tmp_path: Path) -> None:
    results = lab_in(tmp_path) / "results"
    with serving(results, tmp_path / "cache", "--bench", tmp_path / "bench.toml") as station:
        with station.browser() as (client, csrf):
            headers = {"X-CSRF": csrf}
            began = client.post("/api/start", json=START, headers=headers, timeout=90)
            assert began.status_code == 202, began.text
            replayed = client.post("/api/start", json=START, headers=headers, timeout=90)
            name, key = began.json()["name"], began.json()["id"]
            assert (replayed.status_code, replayed.json()["error"]) == (
                409,
                f"{name} is on this bench; wait until it is over, or stop it",
            )
            assert client.get(f"/api/campaigns/{key}").json()["unit"] == "SN-17"
            question = question_in(results / name)
            late = {**ANSWER, "question": f"{question.id}x"}
            assert client.post(f"/api/campaigns/{key}/answer", json=late, headers=headers).status_code == 409
            with station.watch(key) as viewer:
                message = json.loads(viewer.recv(timeout=10))
                assert message["question"] == {"id": question.id, "text": DOOR}
        run = json.loads((results / name / "running.json").read_text())["pid"]
        assert os.getpriority(os.PRIO_PROCESS, run) == os.getpriority(os.PRIO_PROCESS, 0)
        assert os.getsid(run) == run
        station.process.kill()
        station.process.wait(timeout=20)
    answer_question(results / name, question.id, done=True, who="B. Volt")
    ends_s = time.monotonic() + 60.0
    while not (results / name / "manifest.json").exists() and time.monotonic() < ends_s:
        time.sleep(0.2)
    with open_recording(results / name) as recording:
        assert recording.meta.status == "complete"
        assert (recording.meta.unit.serial, recording.meta.provenance["operator"]) == ("SN-17", "A. Ohm")
    assert [event["by"] for event in events(results / name, "started")] == ["A. Ohm, at the live page"]
    assert [event["by"] for event in events(results / name, "operator")] == ["B. Volt, at the live page"]
    assert sorted(path.name for path in results.iterdir()) == [name, f"{name}.log", QUEUE]


@pytest.mark.slow
def test_a_bench_that_another_program_has_is_refused_by_check_and_start_with_its_name(
    lab: Path, tmp_path: Path
) -> None:
    bench, results = lab / "reached.toml", tmp_path / "results"
    results.mkdir()
    with simulated_servers(bench, "--speed", "20"):
        bench.write_text(bench.read_text(encoding="utf-8") + RELEASED, encoding="utf-8")
        with (
            serving(results, tmp_path / "cache", "--bench", bench) as station,
            started("run", lab / "incoming.py", "--bench", bench, "--page", "A. Ohm", "--out", tmp_path / "other"),
            station.client() as client,
        ):
            question_in(tmp_path / "other")
            check = client.post("/api/check", json=ORDER, timeout=60).json()
            start = client.post("/api/start", json=START, timeout=60)
    (problem,) = check["problems"]
    assert not check["ready"]
    assert problem.startswith("rate_table at tcp://127.0.0.1:")
    assert f"(campaign {tmp_path / 'other'}, since" in problem
    assert (start.status_code, start.json()["error"]) == (409, problem)
    assert [path.name for path in results.iterdir()] == [QUEUE]
