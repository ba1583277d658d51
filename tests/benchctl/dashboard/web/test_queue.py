"""Orders that wait behind a run: when they start, when they hold, and that none is carried out twice."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from benchctl.app.station_journal import StationJournal
from benchctl.campaign.page_operator import answer_question
from benchctl.recordings.reader import open_recording
from benchctl_instruments.errors import UsageError
from tests.benchctl.campaign.by_hand import events
from tests.benchctl.cli.processes import benchctl
from tests.benchctl.dashboard.web.serving import serving
from tests.benchctl.dashboard.web.test_starting import QUEUE, START, lab, question_in

__all__ = ["lab"]

pytestmark = pytest.mark.timeout(300)


def order(number: int, **changed: str) -> dict[str, str]:
    """An order for unit SN-number."""
    return START | {"serial": f"SN-{number}", "order": f"{number:016x}", **changed}


def queue_when(client: httpx.Client, holds: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The queue, once it is so."""
    ends_s = time.monotonic() + 90.0
    while time.monotonic() < ends_s:
        queue: dict[str, Any] = client.get("/api/queue").json()
        if holds(queue):
            return queue
        time.sleep(0.2)
    raise AssertionError(json.dumps(queue))


def refused(client: httpx.Client, path: str, body: dict[str, Any]) -> str:
    """Why a request that conflicts with what is there is refused."""
    answer = client.post(path, json=body, timeout=60)
    assert answer.status_code == 409, answer.text
    return str(answer.json()["error"])


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is a thing of POSIX")
def test_an_order_waits_for_the_run_before_survives_the_server_and_holds_after_a_run_that_ended_early(
    lab: Path, tmp_path: Path
) -> None:
    results = tmp_path / "results"
    results.mkdir()
    with (
        serving(results, tmp_path / "cache", "--bench", lab / "bench.toml") as station,
        station.client(timeout_s=90) as client,
    ):
        first = client.post("/api/start", json=order(1)).json()["name"]
        for number in (2, 3, 4):
            assert client.post("/api/queue", json=order(number, who="B. Volt")).status_code == 202
        offline = client.post("/api/check", json={"procedure": "incoming", "serial": "SN-5"}).json()
        assert (offline["ready"], offline["instruments"]) == (True, [])
        assert "placed before" in refused(client, "/api/queue", order(2))
        unmounted = refused(client, "/api/queue", order(5, procedure="hot"))
        assert unmounted.startswith("hot has no step in which SN-4 is replaced by SN-5; add Mount or Ask")
        assert client.post(f"/api/queue/{3:016x}/remove", json={"who": "C. Amp"}).status_code == 202
        assert "not in the queue" in refused(client, f"/api/queue/{3:016x}/remove", {"who": "C. Amp"})
        assert "does not hold" in refused(client, "/api/queue/go_on", {"who": "C. Amp", "hold": 0, "resume": False})
        station.process.kill()
        station.process.wait(timeout=20)
    with (
        serving(results, tmp_path / "cache", "--bench", lab / "bench.toml") as station,
        station.client(timeout_s=90) as client,
    ):
        queue = client.get("/api/queue").json()
        assert (queue["run"]["name"], queue["run"]["fault"]) == (first, None)
        assert [(one["title"], one["serial"], one["who"]) for one in queue["waiting"]] == [
            ("Incoming inspection", "SN-2", "B. Volt"),
            ("Incoming inspection", "SN-4", "B. Volt"),
        ]
        answer_question(results / first, question_in(results / first).id, done=True, who="A. Ohm")
        second = queue_when(client, lambda queue: bool(queue["run"]["serial"] == "SN-2"))["run"]["name"]
        assert refused(client, "/api/start", order(6)).startswith(f"{second} is on this bench")
        answer_question(results / second, question_in(results / second).id, done=False, who="B. Volt")
        queue = queue_when(client, lambda queue: bool(queue["held"]))
        assert queue["held"] == (
            f"{second} did not end properly: stopped by B. Volt, at the live page: refused to close the chamber's door"
        )
        time.sleep(2.5)
        assert client.get("/api/queue").json() == queue  # nothing of it starts
        assert "look at it again" in refused(
            client, "/api/queue/go_on", {"who": "C. Amp", "hold": queue["hold"] - 1, "resume": False}
        )
        go_on = {"who": "C. Amp", "hold": queue["hold"], "resume": True}
        assert client.post("/api/queue/go_on", json=go_on).status_code == 202
        assert refused(client, "/api/queue/go_on", go_on).startswith(f"{second} is on this bench")
        answer_question(results / second, question_in(results / second).id, done=True, who="C. Amp")
        last = queue_when(client, lambda queue: bool(queue["run"]["serial"] == "SN-4"))
        assert (last["held"], last["waiting"]) == ("", [])
        fourth = last["run"]["name"]
        answer_question(results / fourth, question_in(results / fourth).id, done=True, who="B. Volt")
        queue_when(client, lambda queue: bool(queue["run"]["fault"] == ""))
    for name, serial in ((first, "SN-1"), (second, "SN-2"), (fourth, "SN-4")):
        with open_recording(results / name) as recording:
            assert (recording.meta.status, recording.meta.unit.serial) == ("complete", serial)
    started = [event["by"] for event in events(results / second, "started")]
    assert started == ["B. Volt, at the live page", "C. Amp, at the live page"]
    told = [json.loads(line) for line in (results / QUEUE).read_text(encoding="utf-8").splitlines()]
    assert [(one["kind"], one.get("by")) for one in told] == [
        ("started", "A. Ohm"),
        ("queued", "B. Volt"),
        ("queued", "B. Volt"),
        ("queued", "B. Volt"),
        ("removed", "C. Amp"),
        ("over", None),
        ("started", "B. Volt"),
        ("over", None),
        ("resumed", "C. Amp"),
        ("go_on", "C. Amp"),
        ("over", None),
        ("started", "B. Volt"),
        ("over", None),
    ]


@pytest.mark.slow
def test_what_check_refuses_holds_the_queue_until_it_is_removed_and_an_operator_lets_it_go_on(
    lab: Path, tmp_path: Path
) -> None:
    with (
        serving(tmp_path, tmp_path / "cache", "--bench", lab / "bench.toml") as station,
        station.client(timeout_s=90) as client,
    ):
        client.post("/api/queue", json=order(1, procedure="hot"))
        queue = queue_when(client, lambda queue: bool(queue["held"]))
        assert queue["held"].startswith(
            "hot of SN-1 cannot start: procedure static, step 1: soak at +150: goes to 150 °C"
        )
        assert queue["run"] is None
        assert "resumed" in refused(
            client, "/api/queue/go_on", {"who": "C. Amp", "hold": queue["hold"], "resume": True}
        )
        client.post(f"/api/queue/{1:016x}/remove", json={"who": "C. Amp"})
        client.post("/api/queue/go_on", json={"who": "C. Amp", "hold": queue["hold"], "resume": False})
        assert client.get("/api/queue").json() == {"run": None, "held": "", "hold": queue["hold"], "waiting": []}
    assert [path.name for path in tmp_path.glob("*.jsonl")] == [QUEUE]


def test_a_second_server_does_not_start_runs_of_the_same_bench(lab: Path, tmp_path: Path) -> None:
    with serving(tmp_path, tmp_path / "cache", "--bench", lab / "bench.toml") as station:
        second = benchctl("serve", tmp_path, "--bench", lab / "bench.toml")
    assert (second.returncode, second.stdout) == (2, "")
    assert second.stderr.startswith(
        f"benchctl: {lab / 'bench.toml'}: its live page is in use by process {station.process.pid} "
        f"(benchctl serve {tmp_path}, since "
    )


def test_a_refused_start_puts_its_order_back_to_its_place(tmp_path: Path) -> None:
    path = tmp_path / "queue.jsonl"
    journal = StationJournal(path)
    orders = [{"order": f"{number:016x}", "procedure": "x", "serial": "SN", "by": "A"} for number in (1, 2)]
    for one in orders:
        journal.note("queued", **one)
    waiting = journal.waiting
    journal.note("started", **orders[0], campaign="c")
    assert journal.waiting == waiting[1:]
    with path.open("a", encoding="utf-8") as file:
        file.write('{"kind": "refused", "reason": "its last line is torn')
    assert StationJournal(path).waiting == waiting[1:]
    journal.note("refused", reason="in use")
    for one in (journal, StationJournal(path)):
        assert (one.waiting, one.run) == (waiting, None)
        assert one.knows(orders[0]["order"])


def test_a_file_that_is_no_journal_of_a_station_is_said_in_a_line(tmp_path: Path) -> None:
    (tmp_path / "queue.jsonl").write_text('{"kind": "queued"}\n')
    with pytest.raises(UsageError, match="event 1 is not a station's; move the file away"):
        StationJournal(tmp_path / "queue.jsonl")
