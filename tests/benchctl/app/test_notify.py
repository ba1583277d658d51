"""Messages about runs on the simulated bench, received by real servers."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from benchctl.app import notify
from benchctl.app.notify import messages_about
from benchctl.app.run import Watch, play
from benchctl.bench import Bench, load_bench, template
from benchctl.campaign.opened import open_bench
from benchctl.campaign.operator import Meanwhile, Operator
from benchctl.campaign.provenance import recorded_bench
from benchctl.campaign.runner import Outcome, run_campaign
from benchctl.plan import Mount, Plan, Static, Step
from benchctl.recordings.campaign_manifest import problems_of_folder
from benchctl.recordings.reader import open_recording
from tests.benchctl.receiver import Received, receiving
from tests.benchctl.test_certificates import calibrated

pytestmark = pytest.mark.filterwarnings("ignore:'imghdr':DeprecationWarning")  # apprise imports it

HOLD = """
[[interlocks]]
quantity = "setpoint_error_c"
above = -100.0
action = "hold"
give_up_s = 60.0
"""


@dataclass
class Lab:
    """A bench with messages to a server, and the warnings of its runs."""

    folder: Path
    port: int
    received: Received
    warnings: list[str]

    def bench(self, *, tables: str = "", notify: str = "", secret: str = "s3cret") -> Bench:
        path = self.folder / "bench.toml"
        text = path.read_text(encoding="utf-8") if path.exists() else template()
        urls = f'[notify]\nurls = ["json://127.0.0.1:{self.port}/{secret}"]\n{notify}'
        path.write_text(f"{text}\n{urls}\n{tables}\n", encoding="utf-8")
        return load_bench(str(path))

    def play(self, bench: Bench, *steps: Step) -> Outcome:
        return play(_plan(*steps), bench, self.folder / "c", watch=Watch(warn=self.warnings.append))

    def notes(self) -> list[str]:
        lines = (self.folder / "c" / "journal.jsonl").read_text(encoding="utf-8").splitlines()
        return [event["says"] for event in map(json.loads, lines) if event["kind"] == "notify"]


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[Lab]:
    with receiving() as (port, received):
        yield Lab(tmp_path, port, received, [])


def _plan(*steps: Step) -> Plan:
    return Plan(procedure="mine", parameters={}, steps=steps or (Static(duration_s=2.0),), calibrates=False)


def test_a_run_that_ends_sends_its_status_and_where_its_recording_is_and_nothing_stores_the_secret(lab: Lab) -> None:
    lab.play(lab.bench(tables='# "slack://s3cret"'))
    ((title, text),) = lab.received
    assert title == "done: mine, unit SIM-0001, simulated bench"
    assert text == (
        f"complete: 1 of 1 steps complete, 1,000 samples, 0.0 h of bench time\n{(lab.folder / 'c').absolute()}"
    )
    assert (lab.warnings, lab.notes()) == ([], [])
    files = [path for path in (lab.folder / "c").rglob("*") if path.is_file()]
    assert {"recording.h5", "journal.jsonl", "manifest.json"} <= {path.name for path in files}
    assert [path for path in files if b"s3cret" in path.read_bytes()] == []
    with open_recording(lab.folder / "c") as recording:
        assert "json://…" in recording.meta.provenance["bench_toml"]
        assert recorded_bench(recording.meta, "the recording").notify is None  # a repetition sends no messages


def test_a_fault_is_reported_with_its_reason(lab: Lab) -> None:
    stop = '[[interlocks]]\nquantity = "air_c"\nabove = -50.0\n'
    outcome = lab.play(lab.bench(tables=stop))
    assert outcome.status == "aborted"
    ((title, text),) = lab.received
    assert title.startswith("fault: ")
    assert text.startswith("aborted: 0 of 1 steps complete")
    assert "\ninterlock air_c above -50: " in text


def test_a_fault_of_the_program_is_reported_too(lab: Lab, tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), messages_about(_plan(), lab.bench(), tmp_path / "c", lab.warnings.append):
        _ = 1 / 0
    ((title, text),) = lab.received
    assert title.startswith("fault: ")
    assert text.startswith("a fault of the program: ZeroDivisionError")


def test_a_hold_and_an_expired_certificate_are_reported_when_they_occur(lab: Lab) -> None:
    calibrated(lab.folder, chamber="2020-01-31")
    lab.play(lab.bench(tables=HOLD))
    assert [title.partition(":")[0] for title, _ in lab.received] == ["certificate", "hold", "fault"]
    assert lab.received[0][1].startswith("chamber watlow_f4t CH-1: its certificate expired on 2020-01-31\n")
    assert lab.received[1][1].startswith("on hold, the table at rest: setpoint_error_c above -100\n")


@dataclass
class Slow:
    """An operator who takes two looks for each action."""

    operator: Operator
    who: str = "A. Ivanova, at the terminal"

    def mount(self, position: str, meanwhile: Meanwhile) -> None:
        meanwhile()
        meanwhile()


def test_a_question_to_an_operator_is_reported_once(lab: Lab, tmp_path: Path) -> None:
    bench = lab.bench()
    with (
        messages_about(_plan(), bench, tmp_path / "c", lab.warnings.append) as messenger,
        open_bench(bench, wires=False) as opened,
    ):
        slow = replace(opened, operator=Slow(opened.operator))  # type: ignore[arg-type]
        run_campaign(_plan(Mount(position="across")), slow, tmp_path / "c", listener=messenger.hear)
    ((title, text),) = lab.received
    assert title.startswith("hold: ")
    assert text.startswith("waiting for A. Ivanova, at the terminal: mount across\n")


def test_only_the_events_that_are_wanted_are_reported(lab: Lab) -> None:
    lab.play(lab.bench(tables=HOLD, notify='on = ["fault", "guard"]'))
    assert [title.partition(":")[0] for title, _ in lab.received] == ["fault"]


def test_a_dead_address_is_a_warning_and_a_line_in_the_journal_and_the_run_is_sealed(lab: Lab) -> None:
    lab.port = 9  # no server listens on it
    outcome = lab.play(lab.bench(notify='on = ["hold", "fault"]', tables=HOLD))
    assert outcome.status == "aborted"
    assert lab.received == []
    assert len(lab.warnings) == 2
    assert lab.notes() == lab.warnings
    assert all(says.startswith("no message to json://…: ") for says in lab.warnings)
    assert list(problems_of_folder(outcome.campaign)) == []


def test_a_server_that_does_not_answer_delays_no_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(notify, "PATIENCE_S", 0.1)
    answer = threading.Event()
    with receiving(wait=answer) as (port, received):
        lab = Lab(tmp_path, port, received, [])
        outcome = lab.play(lab.bench())
        answer.set()
    assert outcome.status == "complete"
    assert lab.warnings == ["the last messages were not delivered within 0.1 s; look at the network"]


def test_a_recipient_that_cannot_be_used_is_a_warning_before_the_run(lab: Lab) -> None:
    path = lab.folder / "bench.toml"
    path.write_text(f'{template()}\n[notify]\nurls = ["env:NOT_SET", "nope://s3cret"]\n', encoding="utf-8")
    assert lab.play(load_bench(str(path))).status == "complete"
    assert [says.partition(": needs")[0].partition(" is no")[0] for says in lab.warnings] == [
        "notify.urls: env:NOT_SET",
        "notify.urls: nope://…",
    ]
    assert all(says.endswith("; no messages go there") for says in lab.warnings)
