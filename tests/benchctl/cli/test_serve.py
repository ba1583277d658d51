"""`benchctl serve` from its first line to its end."""

import os
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import httpx
import pytest

from benchctl.recordings.writer import write_recording
from tests.benchctl.cli.processes import benchctl
from tests.benchctl.dashboard.web.serving import serving
from tests.benchctl.recordings.made import meta, step
from tests.slowness import slowness

needs_signals = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGTERM to send to another process")


@needs_signals
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["Ctrl-C", "SIGTERM"])
def test_its_first_line_says_where_it_answers_no_other_holds_a_token_and_it_ends_well_within_two_seconds(
    tmp_path: Path, number: signal.Signals
) -> None:
    with serving(tmp_path, tmp_path) as served:
        with served.client() as client:
            assert client.get(f"/api/campaigns?token={served.token}").status_code == 200
        with served.client(f"{served.token}x") as client:
            assert client.get("/api/campaigns").status_code == 401
        with served.line() as line:
            line.sendall(f"GET / {served.token}\r\n\r\n".encode())
            assert b" 400 " in line.recv(4096)
        asked_s = time.monotonic()
        served.process.send_signal(number)
        rest, errors = served.process.communicate(timeout=20)
        took_s = time.monotonic() - asked_s
    assert served.process.returncode == 0
    assert took_s < 2.0 * slowness()
    assert rest == ""
    assert errors.splitlines() == [f"open {served.url}#{served.token}"]


def test_a_folder_that_is_not_there_is_said_in_a_line(tmp_path: Path) -> None:
    ended = benchctl("serve", tmp_path / "nothing")
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr.splitlines() == [
        f"benchctl: {tmp_path / 'nothing'}: is not there, or is no folder; expected a folder with campaigns in it"
    ]


def test_a_port_in_use_is_said_in_a_line(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        ended = benchctl("serve", tmp_path, "--port", str(port))
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr.splitlines() == [
        f"benchctl: --port {port}: is in use by another program on 127.0.0.1; name another, or 0 for any that is free"
    ]


@needs_signals
def test_a_server_for_the_network_warns_that_the_link_is_not_encrypted_and_still_wants_a_token(tmp_path: Path) -> None:
    with serving(tmp_path, tmp_path, "--host", "0.0.0.0") as served:
        assert served.url.startswith("http://127.0.0.1:")
        with served.client(None) as client:
            assert client.get("/api/campaigns").status_code == 401
        errors = served.stop()
    assert errors.startswith("benchctl: warning: --host 0.0.0.0: the link is not encrypted")
    assert f"ssh -L {served.port}:127.0.0.1:{served.port}" in errors


@needs_signals
def test_read_only_lets_nobody_stop_a_run_and_it_always_gives_way_to_one_on_the_same_machine(tmp_path: Path) -> None:
    with serving(tmp_path, tmp_path, "--read-only") as served, served.browser() as (client, _):
        assert client.get("/api/session").json()["role"] == "viewer"
        lowest, own = 19, os.getpriority(os.PRIO_PROCESS, os.getpid())
        assert os.getpriority(os.PRIO_PROCESS, served.process.pid) == min(own + 5, lowest)


def test_without_the_extra_it_says_how_to_install_it(tmp_path: Path) -> None:
    hidden = (
        "import sys; sys.modules['uvicorn'] = None\n"
        "from benchctl.cli.app import run_verb\n"
        f"sys.exit(run_verb(['serve', {str(tmp_path)!r}]))"
    )
    ended = subprocess.run([sys.executable, "-c", hidden], capture_output=True, text=True, timeout=150)
    assert ended.returncode == 2
    assert ended.stderr.strip() == (
        'benchctl: serve needs uvicorn, which is not installed; pip install "benchctl[dashboard]"'
    )


@needs_signals
@pytest.mark.slow
def test_it_ends_as_quickly_in_the_middle_of_a_large_recording_with_websockets_open(tmp_path: Path) -> None:
    write_recording(tmp_path / "large.h5", meta(), [step(1, rows=3_000_000)])
    with serving(tmp_path, tmp_path / "cache") as served, ThreadPoolExecutor() as asking:
        key = served.key_of("large")
        wanted = {"from_s": 0, "to_s": 1e6, "pixels": 4000}

        def ask(channel: str) -> None:
            with served.client() as client, suppress(httpx.TransportError):  # it may be cut off
                client.get(f"/api/campaigns/{key}/series", params={**wanted, "channel": channel})

        with served.watch(key), served.watch(key):
            asked = [asking.submit(ask, channel) for channel in ("gyro_v", "encoder_deg", "rate_dps", "gyro_temp_c")]
            time.sleep(0.5)
            asked_s = time.monotonic()
            errors = served.stop()
            took_s = time.monotonic() - asked_s
        for one in asked:
            one.result()
    assert served.process.returncode == 0
    assert took_s < 2.0 * slowness()
    assert len(errors.splitlines()) == 1
