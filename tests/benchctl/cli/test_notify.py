"""`benchctl notify`, and `benchctl run` on a bench with `[notify]`, from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchctl.bench import template
from tests.benchctl.cli.processes import benchctl, without_a_process
from tests.benchctl.receiver import receiving, receiving_mail

pytestmark = pytest.mark.filterwarnings("ignore:'imghdr':DeprecationWarning")  # apprise imports it

TEST = ("test: simulated bench", "a test message of benchctl notify: messages arrive here")


def _bench(folder: Path, *urls: str) -> Path:
    path = folder / "bench.toml"
    path.write_text(f"{template()}\n[notify]\nurls = {json.dumps(urls)}\n", encoding="utf-8")
    return path


def test_a_test_message_reaches_chat_and_mail(tmp_path: Path) -> None:
    with receiving() as (port, received), receiving_mail() as (mail_port, mails):
        mail = f"mailto://user:s3cret@127.0.0.1:{mail_port}?from=bench@example.org&to=lab@example.org&mode=insecure"
        bench = _bench(tmp_path, f"json://127.0.0.1:{port}/s3cret", mail)
        ran = without_a_process("notify", "--test", "--bench", bench, "--json", tmp_path / "told.json")
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout.splitlines()[:2] == ["json://…: delivered", "mailto://…: delivered"]
    assert received == [TEST]
    assert TEST[1] in mails[0][1]
    told = json.loads((tmp_path / "told.json").read_text(encoding="utf-8"))
    assert [one["delivered"] for one in told["recipients"]] == [True, True]
    assert "s3cret" not in json.dumps(told)


def test_without_test_nothing_is_sent(tmp_path: Path) -> None:
    with receiving() as (port, received):
        _bench(tmp_path, f"json://127.0.0.1:{port}/s3cret")
        ran = without_a_process("notify", folder=tmp_path)
    assert (ran.returncode, ran.stdout.splitlines()[0]) == (0, "json://…: can be used")
    assert received == []


def test_a_message_that_is_not_delivered_is_status_3_and_the_others_are_sent(tmp_path: Path) -> None:
    with receiving() as (port, received):
        bench = _bench(tmp_path, "json://127.0.0.1:9/s3cret", f"json://127.0.0.1:{port}")
        ran = without_a_process("notify", "--test", "--bench", bench)
    assert ran.returncode == 3
    assert ran.stdout.splitlines()[1] == "json://…: delivered"
    assert received == [TEST]
    (line,) = ran.stderr.splitlines()
    assert line.startswith("benchctl: no message to json://…: ")
    assert "s3cret" not in ran.stdout + ran.stderr


def test_an_unknown_url_and_a_bench_without_recipients_are_status_2(tmp_path: Path) -> None:
    bench = _bench(tmp_path, "json://127.0.0.1:9", "nope://s3cret")
    ran = without_a_process("notify", "--test", "--bench", bench)
    assert ran.returncode == 2
    assert ran.stderr.startswith("benchctl: notify.urls: nope://… is no URL that apprise can use: ")
    assert "s3cret" not in ran.stdout + ran.stderr
    ran = without_a_process("notify", "--test", "--bench", "simulated")
    assert (ran.returncode, ran.stderr) == (
        2,
        "benchctl: bench simulated bench: there is no [notify] with urls in its file; add it to get messages\n",
    )


@pytest.mark.slow
def test_a_run_sends_its_end_and_the_error_of_its_fit(tmp_path: Path) -> None:
    with receiving() as (port, received):
        bench = _bench(tmp_path, f"json://127.0.0.1:{port}/s3cret", "json://127.0.0.1:9")
        few = ("-p", "soak_s=600", "-p", "rates=3", "-p", "run_s=10", "-p", "zero_s=10")
        ran = benchctl("run", "rate_sweep", "--bench", bench, *few, "--out", tmp_path / "c", "--quiet")
    assert ran.returncode == 0
    assert [title.partition(":")[0] for title, _ in received] == ["done", "result"]
    assert received[1][1].startswith("error on runs kept aside: raw ")
    lines = ran.stderr.splitlines()
    assert len(lines) == 2
    assert all(line.startswith("benchctl: warning: no message to json://…: ") for line in lines)
    assert benchctl("verify", tmp_path / "c").returncode == 0
