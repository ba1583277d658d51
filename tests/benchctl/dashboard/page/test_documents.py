"""What was stated of campaigns: calibrations, an acceptance, a diagnosis, units over time; and two sweeps beside."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.benchctl.dashboard.page.browsing import TELEPHONE, Seen, Served, a_page, picture, serving, sideways
from tests.benchctl.diagnosis.moving import KINDS, write_moving

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

_SWEEP = ("rate_sweep", "-p", "soak_s=300", "-p", "rates=4", "-p", "run_s=20", "-p", "zero_s=20")


def benchctl(*arguments: str | Path, status: int = 0) -> None:
    """A verb to its end."""
    done = subprocess.run([sys.executable, "-m", "benchctl", *map(str, arguments), "--quiet"], stderr=subprocess.PIPE)
    assert done.returncode == status, done.stderr


@pytest.fixture(scope="module")
def campaigns(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sweeps of one unit, the second accepted; and a recording of a gyro that is not linear, diagnosed."""
    root, lab = tmp_path_factory.mktemp("campaigns"), tmp_path_factory.mktemp("lab")
    benchctl("init", lab)
    for name, seed in (("day_1", "1"), ("day_2", "2")):
        benchctl("run", *_SWEEP, "--bench", "simulated", "--out", root / name, "--seed", seed)
    benchctl("accept", root / "day_2", "--limits", lab / "limits.toml", status=1)  # a sweep alone settles few of them
    benchctl("diagnose", write_moving(root / "hidden.h5", squared_v=2e-6, kinds=KINDS * 2))
    return root


@pytest.fixture(scope="module")
def served(campaigns: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A server before them."""
    with serving(campaigns, tmp_path_factory.mktemp("cache")) as server:
        yield server


@pytest.fixture
def seen(browser: Browser, served: Served) -> Iterator[Seen]:
    """A page of somebody who only looks."""
    with a_page(browser, served.url) as seen:
        seen.page.goto(f"{served.url}#{served.view_token}")
        expect(seen.page.locator(".campaigns > li")).to_have_count(3)
        yield seen


def open_tab(page: Page, name: str, tab: str) -> None:
    """From the list to a page of a campaign."""
    page.locator(".campaigns a", has=page.get_by_text(name, exact=True)).click()
    page.get_by_role("link", name=tab, exact=True).click()


def open_report(page: Page, heading: str) -> None:
    """The full report opens in a frame that runs nothing, and shows its heading."""
    page.get_by_role("button", name="Open the full report").click()
    expect(page.locator("iframe")).to_have_attribute("sandbox", "")
    expect(page.frame_locator("iframe").get_by_role("heading", name=heading).first).to_be_visible()
    page.get_by_role("button", name="Close the full report").click()
    expect(page.locator("iframe")).to_have_count(0)


def test_the_list_says_what_was_stated_of_each_campaign(seen: Seen) -> None:
    for name, tags in (("day_1", ["calibrated"]), ("day_2", ["calibrated", "accepted"]), ("hidden", ["diagnosed"])):
        row = seen.page.locator(".campaigns > li", has=seen.page.get_by_text(name, exact=True))
        expect(row.locator(".tag")).to_have_text(tags)


def test_a_calibration_is_told_in_short_and_its_report_runs_nothing(seen: Seen, campaigns: Path) -> None:
    page = seen.page
    stated = json.loads((campaigns / "day_1" / "coefficients.json").read_text())["uncertainty"]["parameters"]
    open_tab(page, "day_1", "Calibration")
    expect(page.locator(".levels li").filter(has_text="Joint fit")).to_contain_text("%")
    row = page.locator("tbody tr", has_text="K0_v_per_dps")
    expect(row.locator("td").nth(1)).to_have_text(stated["K0_v_per_dps"]["stated"])
    assert stated["K0_v_per_dps"]["stated"] in (campaigns / "day_1" / "report.html").read_text()
    picture(page, "calibration-light", whole=True)
    open_report(page, "Calibration report")


def test_an_acceptance_shows_each_test_with_its_verdict(seen: Seen, campaigns: Path) -> None:
    page = seen.page
    stated = json.loads((campaigns / "day_2" / "acceptance.json").read_text())
    open_tab(page, "day_2", "Acceptance")
    expect(page.locator(".verdict .chip")).to_have_text(stated["verdict"])
    rows = page.locator("tbody tr")
    expect(rows).to_have_count(len(stated["tests"]))
    expect(page.locator("p.verdict")).to_contain_text(stated["tally"])
    assert stated["tally"] in (campaigns / "day_2" / "acceptance.html").read_text()
    for row, test in zip(rows.all(), stated["tests"], strict=True):
        without = "not measured" if test["value"] is None else "no limit"
        assert row.locator("td").nth(0).inner_text() == (test["verdict"] or without)
        expect(row.locator("td").nth(1)).to_have_text(test["stated"])
    expect(rows.filter(has_text="bandwidth")).to_contain_text("at least 10 Hz")
    picture(page, "acceptance-light", whole=True)
    open_report(page, "Acceptance")


def test_a_diagnosis_shows_what_is_missing_how_sure_that_is_and_where(seen: Seen) -> None:
    page = seen.page
    open_tab(page, "hidden", "Diagnosis")
    expect(page.locator(".verdict .chip")).to_have_text("missing-physics")
    finding = page.locator(".finding", has_text="rate squared").first
    expect(finding.locator("tbody")).to_contain_text("v_per_dps2")
    expect(finding).to_contain_text("in twice the log likelihood")
    finding.get_by_role("button", name="What is this?").click()
    expect(finding.locator(".block").first).to_be_visible()
    assert page.locator(".maps .chart").count() >= 5
    expect(page.get_by_role("img", name="rate: at most", exact=False).first).to_be_visible()
    picture(page, "diagnosis-light", whole=True)
    page.get_by_role("button", name="dark or light").click()
    picture(page, "diagnosis-dark")
    open_report(page, "Diagnosis")


def test_units_over_time_are_charted_and_searched(seen: Seen) -> None:
    page = seen.page
    page.get_by_role("link", name="History", exact=True).click()
    card = page.locator(".unit-card")
    expect(card).to_have_count(1)
    chart = card.get_by_role("img", name="K0_v_per_dps: 2 values", exact=False)
    expect(chart).to_be_visible()
    picture(page, "history-light")
    page.get_by_label("Search").fill("nobody")
    expect(card).to_have_count(0)


def test_two_sweeps_are_laid_over_each_other_step_by_step(seen: Seen) -> None:
    page = seen.page
    page.get_by_label("compare day_1").check()
    page.get_by_label("compare day_2").check()
    page.get_by_role("button", name="Compare these two").click()
    expect(page.locator(".zoom")).to_have_attribute("aria-busy", "false")
    page.get_by_label("Aligned by").select_option(label="step 6, rate -85 at +20: both from its beginning")
    expect(page.locator(".zoom")).to_have_attribute("aria-busy", "false")
    expect(page.locator(".zoom > .how")).to_contain_text("A: day_")
    picture(page, "compare-step-light", whole=True)
    assert "no samples" not in page.locator(".zoom > .how").inner_text()


def test_documents_are_no_wider_than_a_telephone(browser: Browser, served: Served) -> None:
    with a_page(browser, served.url, TELEPHONE) as seen:
        page = seen.page
        for name, tab in (("day_1", "Calibration"), ("day_2", "Acceptance"), ("hidden", "Diagnosis")):
            page.goto(f"{served.url}#{served.token}")  # again in the same tab: taken from the address all the same
            expect(page.get_by_role("heading", name="Campaigns")).to_be_visible()
            assert served.token not in page.url
            open_tab(page, name, tab)
            expect(page.locator(".page table").first).to_be_visible()
            assert sideways(page) <= 0, tab
            picture(page, f"telephone-{tab.lower()}", whole=True)
