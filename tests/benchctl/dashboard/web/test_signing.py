"""The verdict on a run that was started at the page, and its signature by the key that lies on the station."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from benchctl.app.station import Station
from benchctl.bench import template
from benchctl_instruments.errors import UsageError
from tests.benchctl.cli.processes import without_a_process
from tests.benchctl.cli.test_accept import PASSES, SHORT
from tests.benchctl.dashboard.web.serving import Served, serving
from tests.benchctl.test_sshsig import key_file

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

RELEASED = """
[laboratory]
name = "Gyro laboratory"
signing_key = "anna"
[released.short]
procedure = "short.py"
limits = "limits.toml"
"""
SIGN = {"verdict": "PASS", "who": "A. Petrova"}


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a bench that releases a procedure with limits, the key, and an empty folder for results."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "short.py").write_text(SHORT)
    (folder / "limits.toml").write_text(PASSES)
    key_file(folder / "anna")
    (folder / "bench.toml").write_text(template() + RELEASED, encoding="utf-8")
    (folder / "results").mkdir()
    return folder


@pytest.fixture(scope="module")
def station(lab: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A server that may start and sign."""
    with serving(lab / "results", tmp_path_factory.mktemp("cache"), "--bench", lab / "bench.toml") as server:
        yield server


@pytest.fixture(scope="module")
def judged(lab: Path, station: Served) -> Path:
    """A campaign that was started at the page and judged by its limits."""
    order = {"procedure": "short", "serial": "SN-17", "who": "A. Ohm", "order": "0123456789abcdef"}
    with station.client(timeout_s=90) as client:
        name = client.post("/api/start", json=order).json()["name"]
        ends_s = time.monotonic() + 90.0
        while client.get("/api/queue").json()["run"]["fault"] is None and time.monotonic() < ends_s:
            time.sleep(0.2)
        assert client.get("/api/queue").json()["run"]["fault"] == ""
    return lab / "results" / name


def copy_of(judged: Path, name: str) -> Path:
    """A copy of a campaign beside it."""
    return Path(shutil.copytree(judged, judged.with_name(name)))


def refusal(client: httpx.Client, station: Served, folder: Path, **changed: str) -> tuple[int, str]:
    answer = client.post(f"/api/campaigns/{station.key_of(folder.name)}/sign", json=SIGN | changed)
    assert not (folder / "acceptance.signed.json").exists()
    return answer.status_code, answer.json()["error"]


def test_only_who_releases_signs_from_this_page_what_they_have_seen_and_once(
    lab: Path, station: Served, judged: Path, tmp_path: Path
) -> None:
    before = copy_of(judged, "before")
    key = station.key_of(judged.name)
    path = f"/api/campaigns/{key}/sign"
    for token, says in ((station.view_token, "this token only looks"), (station.token, "this token does not sign")):
        with station.client(token) as client:
            assert refusal(client, station, judged) == (
                403,
                f"{says}; who signs an acceptance logs in with release_token of benchctl serve",
            )
            assert client.get(f"/api/campaigns/{key}/documents/acceptance").json()["signed"] is None
        with station.browser(token) as (client, _):
            assert client.get("/api/session").json()["may_sign"] is False
    with station.browser(station.release_token) as (client, csrf):
        assert client.get("/api/session").json() | {"csrf": ""} == {
            "role": "releaser",
            "csrf": "",
            "may_start": True,
            "may_sign": True,
        }
        for headers in ({}, {"X-CSRF": "x"}, {"X-CSRF": csrf, "Origin": "http://evil.example"}):
            assert client.post(path, json=SIGN, headers=headers).status_code == 403
        client.headers["X-CSRF"] = csrf
        assert refusal(client, station, judged, verdict="FAIL") == (
            409,
            f"the verdict on {judged.name} is not FAIL any more; look at it again",
        )
        signed = client.post(path, json=SIGN, timeout=90)
        assert signed.status_code == 202, signed.text
        replayed = client.post(path, json=SIGN, timeout=90)
        refused = f"{judged.name} is signed already; benchctl verify states by whom"
        assert (replayed.status_code, replayed.json()["error"]) == (409, refused)
        shown = client.get(f"/api/campaigns/{key}/documents/acceptance").json()
        assert (shown["verdict"], shown["signed"]) == ("PASS", signed.json())
        report = client.get(f"/api/campaigns/{key}/documents/acceptance/report").text
        assert "Anna Petrova (QA)" in report
    lines = (lab / "results" / "queue-simulated-bench.jsonl").read_text().splitlines()
    (line,) = [one for one in lines if "signed" in one]
    assert (json.loads(line)["by"], json.loads(line)["campaign"]) == ("A. Petrova", judged.name)
    delivered = shutil.copytree(judged, tmp_path / "delivered")
    verified = without_a_process("verify", delivered)
    assert (verified.returncode, verified.stderr) == (0, "")
    assert shown["signed"]["says"] in verified.stdout.splitlines()
    assert shown["signed"]["problems"] == []
    assert without_a_process("verify", before).returncode == 0


def test_what_was_changed_or_judged_by_other_limits_is_not_signed(lab: Path, station: Served, judged: Path) -> None:
    altered, other = copy_of(judged, "altered"), copy_of(judged, "other")
    for folder in (altered, other):
        for name in ("acceptance.signed.json", "acceptance.signed.json.sig"):
            (folder / name).unlink(missing_ok=True)
    (altered / "acceptance.html").write_text("<p>PASS</p>")
    limits = lab / "limits.toml"
    with station.client(station.release_token) as client:
        status, says = refusal(client, station, altered)
        assert (status, says.partition(":")[0]) == (409, "acceptance.html")
        try:
            limits.write_text(PASSES + "# the lab has changed them\n")
            status, says = refusal(client, station, other)
        finally:
            limits.write_text(PASSES)
        assert status == 409
        assert says.startswith("other was judged by other limits than ")


def test_a_key_or_limits_that_are_not_there_are_said_before_anything_is_served(lab: Path, tmp_path: Path) -> None:
    for name, says in (
        ("anna", "laboratory.signing_key: expected a key file"),
        ("limits.toml", "limits .*: cannot be read"),
    ):
        folder = tmp_path / name
        shutil.copytree(lab, folder, ignore=shutil.ignore_patterns(name, "results"))
        with pytest.raises(UsageError, match=says):
            Station(folder / "bench.toml", folder)


def test_a_run_at_the_command_line_is_judged_by_its_limits_and_fails_as_accept_does(lab: Path, tmp_path: Path) -> None:
    (tmp_path / "limits.toml").write_text(PASSES.replace("low = 40", "low = 59"))
    run = (
        "run",
        lab / "short.py",
        "--bench",
        "simulated",
        "--limits",
        "limits.toml",
        "--out",
        "unit",
        "--json",
        "a.json",
    )
    ran = without_a_process(*run, folder=tmp_path)
    told = json.loads((tmp_path / "a.json").read_text())
    assert (ran.returncode, told["ok"], told["verdict"], told["error"]) == (1, False, "FAIL", "fails scale_factor")
    assert json.loads((tmp_path / "unit" / "acceptance.json").read_text())["verdict"] == "FAIL"
