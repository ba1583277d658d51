"""A run over real wires, watched and stopped over HTTP, the bench asked by somebody else."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import pytest

from benchctl.recordings.campaign_manifest import problems_of_folder
from benchctl.recordings.reader import open_recording
from tests.benchctl.cli.foreign_eyes import ForeignEyes
from tests.benchctl.cli.processes import simulated_servers, started
from tests.benchctl.cli.test_stopping import PROCEDURE
from tests.benchctl.dashboard.web.serving import serving

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGTERM to send to another process"),
]


def test_the_page_stops_a_run_as_ctrl_c_does_and_the_bench_is_at_rest_within_five_seconds(tmp_path: Path) -> None:
    campaign, result = tmp_path / "results" / "swing 1", tmp_path / "result.json"
    campaign.parent.mkdir()
    (tmp_path / "swing.py").write_text(PROCEDURE)
    with (
        simulated_servers(tmp_path / "bench.toml", "--speed", "50") as addresses,
        ForeignEyes(addresses) as eyes,
        serving(campaign.parent, tmp_path / "cache") as served,
        started(
            *("run", tmp_path / "swing.py", "--bench", tmp_path / "bench.toml"),
            *("--out", campaign, "--json", result, "-q"),
        ) as run,
    ):
        eyes.wait_for_swing(run)
        key = served.key_of(campaign.name)
        with served.browser() as (client, csrf), served.watch(key) as viewer:
            assert json.loads(viewer.recv(timeout=10))["stop_asked"] is False
            asked_s = time.monotonic()
            stopped = client.post(
                f"/api/campaigns/{key}/stop", json={"confirm": campaign.name}, headers={"X-CSRF": csrf}
            )
            assert stopped.status_code == 202
            _, errors = run.communicate(timeout=20)
            took_s = time.monotonic() - asked_s
            assert run.returncode == 3
            assert took_s < 5.0
            assert abs(eyes.rate_dps()) < 0.05
            assert eyes.chamber_setpoint_c() == pytest.approx(23.0)
            while json.loads(viewer.recv(timeout=10))["status"] != "interrupted":
                pass
            again = client.post(f"/api/campaigns/{key}/stop", json={"confirm": campaign.name}, headers={"X-CSRF": csrf})
            assert again.status_code == 409
    assert errors.strip() == "benchctl: stopped by the live page (operator)"
    assert json.loads(result.read_text())["status"] == "interrupted"
    with open_recording(campaign) as recording:
        assert recording.meta.provenance["reason"] == "stopped by the live page (operator)"
        assert recording.infos[1].samples > 1000
    assert list(problems_of_folder(campaign)) == []
    assert not list(campaign.glob("stop*"))
