"""A run whose live page is attacked: it loses nothing, even if the page answers no request."""

from __future__ import annotations

import json
import socket
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import httpx
import pytest

from benchctl.recordings.reader import open_recording
from benchctl.recordings.verify import verify
from tests.benchctl.cli.processes import simulated_servers, started
from tests.benchctl.dashboard.web.serving import Served, serving
from tests.benchctl.dashboard.web.test_connections import CROWD, CROWDS
from tests.benchctl.dashboard.web.test_live_routes import deaf_viewer

PROCEDURE = """
from benchctl.plan import ConstantRate, Static, procedure

@procedure()
def steady():
    '''Rest and rates, long enough to be looked at.'''
    yield Static(duration_s=100.0)
    yield ConstantRate(rate_dps=90.0, duration_s=200.0)
    yield Static(duration_s=100.0)
"""
SPEED = 20.0
RATE_HZ = 500.0


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_run_loses_no_sample_while_a_thousand_connections_are_open_to_its_page(tmp_path: Path) -> None:
    campaign, result = tmp_path / "results" / "steady", tmp_path / "result.json"
    campaign.parent.mkdir()
    (tmp_path / "steady.py").write_text(PROCEDURE)
    over = threading.Event()
    held: list[socket.socket] = []
    with ExitStack() as stack:
        stack.enter_context(simulated_servers(tmp_path / "bench.toml", "--speed", str(SPEED)))
        served = stack.enter_context(serving(campaign.parent, tmp_path / "cache"))
        run = stack.enter_context(
            started(
                *("run", tmp_path / "steady.py", "--bench", tmp_path / "bench.toml"),
                *("--out", campaign, "--json", result, "-q"),
            )
        )
        key = served.key_of(campaign.name)
        attacks = [threading.Thread(target=attack, args=(served, key, over, which, held)) for which in range(4)]
        for one in attacks:
            one.start()
        run.wait()
        over.set()
        for one in attacks:
            one.join()
        assert run.returncode == 0, run.communicate()
        assert served.key_of(campaign.name) == key
        assert served.stop().count("\n") == 1
    assert len(held) == CROWD  # counted by the attackers, since the page closes those that it has answered
    assert json.loads(result.read_text())["status"] == "complete"
    with open_recording(campaign) as recording:
        assert [(info.whole, info.gaps) for info in recording.infos] == [(True, 0)] * 3
        assert [info.samples for info in recording.infos] == [50_000, 100_000, 50_000]
    assert verify(campaign) == []


def attack(served: Served, key: str, over: threading.Event, which: int, held: list[socket.socket]) -> None:
    """One of four attackers, until the run is over: viewers that read nothing, requests to stop it, connections.

    `held` receives the connections that stay open as long as the attack.
    """
    with ExitStack() as stack:
        for number in range(CROWD // 2 if which >= 2 else 0):
            line = stack.enter_context(served.line())
            CROWDS[number % 3](line, number)
            held.append(line)
        while not over.is_set():
            with ExitStack() as viewers, suppress(OSError, httpx.TransportError):
                for number in range(150):
                    if over.is_set():
                        return
                    if which == 0:
                        viewers.enter_context(deaf_viewer(served, key))
                        over.wait(0.1)
                    elif which == 1:
                        stop_it(served, key)
                    else:
                        CROWDS[number % len(CROWDS)](viewers.enter_context(served.line()), number)


def stop_it(served: Served, key: str) -> None:
    """Try to stop the run without the right to."""
    with served.client(served.view_token) as viewer, served.client(f"{served.token}x") as nobody:
        for client in (viewer, nobody):
            refused = client.post(f"/api/campaigns/{key}/stop", json={"confirm": "steady"})
            assert refused.status_code in (401, 403, 503)
            time.sleep(0.02)
