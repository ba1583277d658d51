"""From the choice of a procedure to the end of its run, in a browser: what QA does."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from benchctl.bench import template
from benchctl.recordings.reader import open_recording
from tests.benchctl.dashboard.page.browsing import TELEPHONE, Served, a_page, picture, serving, sideways
from tests.benchctl.dashboard.web.test_starting import DOOR, PROCEDURE, RELEASED

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

_MS = 90_000
"""For what waits for a program to start, on a machine with much else to do."""


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """The folder of a lab's campaigns, empty; beside it the bench that releases a procedure."""
    (tmp_path / "bench.toml").write_text(template() + RELEASED, encoding="utf-8")
    (tmp_path / "incoming.py").write_text(PROCEDURE)
    (tmp_path / "results").mkdir()
    return tmp_path / "results"


@pytest.fixture
def station(results: Path, tmp_path: Path) -> Iterator[Served]:
    """A server that may start what the lab has released."""
    with serving(results, tmp_path / "cache", "--bench", str(tmp_path / "bench.toml")) as server:
        yield server


def scan(page: Page, serial: str) -> None:
    """What a scanner does: it types, and ends with Enter."""
    page.keyboard.type(serial)
    page.keyboard.press("Enter")


def begin(page: Page, station: Served) -> None:
    """Log in, open the view, scan a unit; wait until it can start."""
    page.goto(f"{station.url}#{station.token}")
    page.get_by_role("link", name="Start", exact=True).click()
    expect(page.get_by_label("Serial number of the unit")).to_be_focused()
    scan(page, "SN-17")
    expect(page.get_by_role("status").filter(has_text="Can start: 2 steps")).to_be_visible(timeout=_MS)


def test_a_unit_is_scanned_checked_started_and_its_question_answered(
    browser: Browser, station: Served, results: Path
) -> None:
    with a_page(browser, station.url, (1440, 900)) as seen:
        page = seen.page
        begin(page, station)
        start = page.get_by_role("button", name="Start the run")
        expect(page.locator(".outcome")).to_contain_text(DOOR)
        page.get_by_label("Procedure").select_option("hot")
        expect(start).to_be_disabled()  # what was checked is another procedure
        page.get_by_label("Serial number of the unit").focus()
        page.keyboard.press("Enter")
        refused = page.get_by_role("status").filter(has_text="Cannot start.")
        expect(refused).to_contain_text("goes to 150 °C, the bench's limits are -55 to 85 °C", timeout=_MS)
        expect(start).to_be_disabled()
        picture(page, "start-refused-light")
        page.get_by_label("Procedure").select_option("incoming")
        page.get_by_label("Serial number of the unit").select_text()
        scan(page, "SN-18")
        expect(start).to_be_enabled(timeout=_MS)
        start.click()  # nobody has given a name yet
        expect(page.get_by_label("Your name")).to_be_focused()
        page.keyboard.type("A. Ohm")
        picture(page, "start-ready-light")
        start.click()
        question = page.get_by_role("alert").filter(has_text=f"Now: {DOOR}")
        expect(question).to_be_visible(timeout=_MS)
        expect(question.get_by_label("Your name")).to_have_value("A. Ohm")
        picture(page, "question-light")
        question.get_by_label("Your name").fill("B. Volt")
        question.get_by_role("button", name="It is done").click()
        expect(page.locator(".banner").filter(has_text="The run has ended: complete")).to_be_visible(timeout=_MS)
    (campaign,) = (path for path in results.iterdir() if path.is_dir())
    with open_recording(campaign) as recording:
        assert recording.meta.unit.serial == "SN-18"
        told = recording.meta.provenance["journal"]
    by = {event["kind"]: event["by"] for event in map(json.loads, told.splitlines()) if "by" in event}
    assert (by["started"], by["operator"]) == ("A. Ohm, at the live page", "B. Volt, at the live page")


def test_on_a_telephone_a_question_is_refused_by_holding_and_who_only_looks_cannot_answer(
    browser: Browser, station: Served
) -> None:
    with a_page(browser, station.url, TELEPHONE, dark=True) as seen, a_page(browser, station.url) as looks:
        page = seen.page
        begin(page, station)
        page.get_by_label("Your name").fill("A. Ohm")
        assert sideways(page) <= 0
        picture(page, "telephone-start-dark", whole=True)
        page.get_by_role("button", name="Start the run").click()
        question = page.get_by_role("alert").filter(has_text=f"Now: {DOOR}")
        expect(question).to_be_visible(timeout=_MS)
        assert sideways(page) <= 0
        picture(page, "telephone-question-dark")
        looks.page.goto(f"{station.url}#{station.view_token}")
        expect(looks.page.get_by_role("link", name="Start", exact=True)).to_have_count(0)
        looks.page.locator(".campaigns a").click()
        same = looks.page.get_by_role("alert").filter(has_text=f"Now: {DOOR}")
        expect(same).to_contain_text("The run waits for the operator.")
        expect(same.get_by_role("button")).to_have_count(0)
        question.get_by_role("button", name="Refuse").hover()
        page.mouse.down()
        page.wait_for_timeout(2300)
        page.mouse.up()
        expect(page.locator(".banner").filter(has_text="The run has ended: interrupted")).to_be_visible(timeout=_MS)
