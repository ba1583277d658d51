"""The whole day of QA in a browser: two units, a run that dies, a verdict, a signature, and the check of a copy."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from benchctl.bench import template
from benchctl.campaign.page_operator import answer_question
from benchctl.recordings.reader import open_recording
from tests.benchctl.cli.processes import without_a_process
from tests.benchctl.cli.test_accept import PASSES
from tests.benchctl.dashboard.page.browsing import TELEPHONE, Served, a_page, picture, serving, sideways
from tests.benchctl.dashboard.page.test_start import scan
from tests.benchctl.dashboard.web.test_starting import question_in
from tests.benchctl.test_sshsig import key_file

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(400),
    pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is a thing of POSIX"),
]

_MS = 90_000
"""For what waits for a program to start, on a machine with much else to do."""
RELEASED = """
[laboratory]
name = "Gyro laboratory"
signing_key = "anna"
[released.incoming]
title = "Incoming inspection"
procedure = "incoming.py"
limits = "limits.toml"
"""
PROCEDURE = """
from benchctl.plan import Ask, levels, procedure, rate_cycle

@procedure()
def incoming():
    '''Rates up and down with the door closed.'''
    yield Ask(says="close the chamber's door")
    yield from rate_cycle(levels(100.0, 3), at_least_s=5.0, zero_s=10.0)
    yield Ask(says="read the seal of the unit")
"""


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Served]:
    """A server that may start what the lab has released, and sign."""
    (tmp_path / "bench.toml").write_text(template() + RELEASED, encoding="utf-8")
    (tmp_path / "incoming.py").write_text(PROCEDURE)
    (tmp_path / "limits.toml").write_text(PASSES)
    key_file(tmp_path / "anna")
    (tmp_path / "results").mkdir()
    with serving(tmp_path / "results", tmp_path / "cache", "--bench", str(tmp_path / "bench.toml")) as server:
        yield server


def question(page: Page, says: str) -> Locator:
    """The question of the run, once it is asked."""
    asked = page.get_by_role("alert").filter(has_text=f"Now: {says}")
    expect(asked).to_be_visible(timeout=_MS)
    return asked


def answer(page: Page, says: str) -> None:
    question(page, says).get_by_role("button", name="It is done").click()


def order(page: Page, serial: str, button: str) -> None:
    """Scan a unit, and press what is offered once it has been checked."""
    scan(page, serial)
    expect(page.get_by_role("button", name=button)).to_be_enabled(timeout=_MS)
    page.get_by_role("button", name=button).click()


def test_a_unit_is_inspected_through_a_fault_signed_and_verified_elsewhere_while_another_waits(
    browser: Browser, station: Served, tmp_path: Path
) -> None:
    with a_page(browser, station.url, (1440, 900)) as seen, a_page(browser, station.url, TELEPHONE) as telephone:
        page, small = seen.page, telephone.page
        small.goto(f"{station.url}#{station.token}")
        page.goto(f"{station.url}#{station.release_token}")
        page.get_by_role("link", name="Start", exact=True).click()
        page.get_by_label("Your name").fill("A. Petrova")
        page.get_by_label("Serial number of the unit").focus()
        order(page, "SN-21", "Start the run")
        question(page, "close the chamber's door")
        page.get_by_role("link", name="Start", exact=True).click()
        for serial in ("SN-22", "SN-23"):
            expect(page.get_by_label("Serial number of the unit")).to_have_value("")
            order(page, serial, "Put it in the queue")
            expect(
                page.locator(".queue li").filter(has_text=f"Incoming inspection, {serial}, by A. Petrova")
            ).to_be_visible()
        picture(page, "queue-waits-light")
        page.get_by_role("button", name="remove SN-23").click()
        expect(page.locator(".queue li")).to_have_count(1)
        page.locator(".queue").get_by_role("link").click()
        answer(page, "close the chamber's door")
        question(page, "read the seal of the unit")
        (campaign,) = (path for path in (tmp_path / "results").iterdir() if path.is_dir())
        os.kill(json.loads((campaign / "running.json").read_text())["pid"], signal.SIGKILL)
        held = small.locator(".queue").get_by_role("alert")
        expect(held).to_contain_text(
            f"The queue holds: {campaign.name} did not end properly: its program died", timeout=_MS
        )
        assert sideways(small) <= 0
        picture(small, "telephone-queue-holds-light", whole=True)
        held.get_by_role("button", name="Go on with the next").click()  # nobody has given a name there
        expect(small.locator(".queue")).to_contain_text("give your name at Start first")
        page.get_by_role("link", name="Start", exact=True).click()
        expect(page.locator(".queue")).to_contain_text("its program died")
        picture(page, "queue-holds-light")
        page.get_by_role("button", name="Resume this run").click()
        expect(page.locator(".queue")).to_contain_text(f"On the bench: {campaign.name}", timeout=_MS)
        page.locator(".queue").get_by_role("link").click()
        answer(page, "read the seal of the unit")
        expect(page.locator(".verdict")).to_contain_text("PASS", timeout=_MS)
        small.goto(f"{station.url}{page.url.removeprefix(station.url)}")
        expect(small.get_by_text("Not signed.")).to_be_visible()
        expect(small.get_by_role("button", name="Sign")).to_have_count(0)  # the operator does not sign
        expect(page.get_by_label("Your name")).to_have_value("A. Petrova")
        picture(page, "verdict-light", whole=True)
        page.get_by_role("button", name="Sign: PASS").click()
        signed = page.locator(".sign.good")
        expect(signed).to_contain_text("Signed by Anna Petrova (QA), key SHA256:", timeout=_MS)
        picture(page, "signed-light", whole=True)
        small.reload()
        expect(small.locator(".sign.good")).to_contain_text("Signed by Anna Petrova (QA), key SHA256:")
        assert sideways(small) <= 0
        picture(small, "telephone-signed-light", whole=True)
        with page.context.expect_page() as opened:
            page.get_by_role("link", name="To print it").click()
        expect(opened.value.get_by_text("Anna Petrova (QA)").first).to_be_visible()
        says = signed.inner_text()
    delivered = shutil.copytree(campaign, tmp_path / "customer" / "SN-21")
    verified = without_a_process("verify", delivered)
    assert (verified.returncode, verified.stderr) == (0, "")
    assert says[1:] in verified.stdout
    with open_recording(delivered) as recording:
        assert (recording.meta.status, recording.meta.unit.serial) == ("complete", "SN-21")
    (second,) = (path for path in (tmp_path / "results").iterdir() if path.is_dir() and path != campaign)
    assert second.name.endswith("SN-22")
    answer_question(second, question_in(second).id, done=False, who="A. Petrova")
