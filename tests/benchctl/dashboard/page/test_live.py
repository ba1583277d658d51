"""The live page before a run that goes on: on a simulated bench in another process, twenty times faster than real."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.benchctl.cli.processes import simulated_servers
from tests.benchctl.dashboard.page.browsing import TELEPHONE, Served, a_page, picture, serving, sideways

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]

SPEED = "20"
NAME = "20261122-180000_swings_SN-17"
PROCEDURE = """
from benchctl.plan import ConstantRate, Sine, Soak, Static, procedure

@procedure()
def swings():
    '''Swings at three temperatures.'''
    for celsius in (23.0, 35.0, 28.0):
        yield Soak(setpoint_c=celsius, hold_s=60.0, drift_c_per_min=5.0)
        yield Static(duration_s=60.0)
        for rate in (50.0, -50.0, 120.0):
            yield ConstantRate(rate_dps=rate, duration_s=60.0)
        yield Sine(amplitude_dps=100.0, frequency_hz=0.5, cycles=40)
"""


class Lab:
    """A bench, a folder of campaigns, and a run in it."""

    def __init__(self, folder: Path, bench: Path) -> None:
        self.results = folder / "results"
        self.results.mkdir()
        (folder / "swings.py").write_text(PROCEDURE)
        self.command = [sys.executable, "-m", "benchctl", "run", str(folder / "swings.py"), "--bench", str(bench)]
        self.process: subprocess.Popen[bytes] | None = None

    def run(self, *arguments: str) -> None:
        """Begin a run; what it says is nobody's business."""
        self.process = subprocess.Popen(
            [*self.command, "--out", str(self.results / NAME), "--quiet", *arguments],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def end(self) -> None:
        """Kill what still runs."""
        if self.process is not None:
            self.process.kill()
            self.process.wait(timeout=20)


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[Lab]:
    """A run that has begun."""
    with simulated_servers(tmp_path / "bench.toml", "--speed", SPEED):
        lab = Lab(tmp_path, tmp_path / "bench.toml")
        lab.run()
        yield lab
        lab.end()


@pytest.fixture
def served(lab: Lab, tmp_path: Path) -> Iterator[Served]:
    """A server before the run's folder."""
    with serving(lab.results, tmp_path / "cache") as server:
        yield server


def watch(page: Page, served: Served, token: str) -> None:
    """Log in and open the run's live page."""
    page.goto(f"{served.url}#{token}")
    expect(page.locator(".campaigns > li.live")).to_have_count(1, timeout=40_000)
    expect(page.locator(".chip").filter(has_text="running")).to_be_visible()
    expect(page.get_by_role("progressbar", name="steps done")).to_be_visible()
    page.locator(".campaigns a").click()
    expect(page.locator(".where")).to_contain_text("Step")


def value(page: Page, name: str) -> float:
    """What a tile shows."""
    text = page.locator(".tiles li", has=page.get_by_text(name, exact=True)).locator(".value").inner_text()
    found = re.match(r"−?[\d.]+", text)
    return float(found[0].replace("−", "-")) if found else float("nan")


def bench_time_s(page: Page) -> float:
    """The bench time that the page states."""
    hours, minutes, seconds = re.findall(r"bench time (\d+):(\d+):(\d+)", page.locator(".ends").inner_text())[0]
    return 3600 * int(hours) + 60 * int(minutes) + int(seconds)


def until(page: Page, what: str) -> None:
    """Wait until the run is in a step of this name."""
    expect(page.locator(".where")).to_contain_text(what, timeout=60_000)


def test_a_run_is_watched_as_it_goes_on_and_stopped_from_the_page(browser: Browser, lab: Lab, served: Served) -> None:
    with a_page(browser, served.url) as seen:
        page = seen.page
        watch(page, served, served.token)
        until(page, "rate +50")
        page.wait_for_timeout(2000)
        assert value(page, "Rate") == pytest.approx(50.0, abs=0.5)
        assert value(page, "Chamber air") == pytest.approx(23.0, abs=1.0)
        assert value(page, "Output") == pytest.approx(50 * 0.05, rel=0.1)
        expect(page.locator(".limits li").first).to_contain_text(re.compile("inside|near"))
        expect(page.locator(".events li").first).to_be_visible()
        expect(page.locator(".ends")).to_contain_text("ends about")
        picture(page, "live-light")
        before_s = bench_time_s(page)
        page.wait_for_timeout(1500)
        assert 10 < bench_time_s(page) - before_s < 90
        for name in ("1 min", "all"):
            page.get_by_text(name, exact=True).click()
            page.wait_for_timeout(800)
            assert sideways(page) <= 0
        picture(page, "live-all-light")
        page.get_by_role("button", name="dark or light").click()
        page.wait_for_timeout(600)
        picture(page, "live-dark")
        stop_by_name(page)
        expect(page.locator(".banner").filter(has_text="The run has ended: interrupted")).to_be_visible(timeout=30_000)
        picture(page, "stopped-dark")
        expect(page.locator("h1 + .chip")).to_contain_text("interrupted")
        assert lab.process is not None
        assert lab.process.wait(timeout=20) == 3
        expect(page.locator(".zoom")).to_have_attribute("aria-busy", "false")


def stop_by_name(page: Page) -> None:
    """Ask to stop, and type the name."""
    page.get_by_role("button", name="Stop …").click()
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("The table comes to rest.")
    expect(dialog).to_contain_text("The chamber goes to its safe set point.")
    stop = dialog.get_by_role("button", name="Stop the run", exact=True)
    expect(stop).to_be_disabled()
    dialog.get_by_role("textbox").fill("something else")
    expect(stop).to_be_disabled()
    picture(page, "stop-dialog-dark")
    dialog.get_by_role("textbox").fill(NAME)
    stop.click()
    expect(page.locator(".banner").filter(has_text="Stop was asked for at")).to_be_visible()


def test_a_run_is_stopped_by_holding_and_going_on_without_it_is_the_first_choice(
    browser: Browser, lab: Lab, served: Served
) -> None:
    with a_page(browser, served.url, TELEPHONE, still=True) as seen:
        page = seen.page
        watch(page, served, served.token)
        until(page, "static")
        page.wait_for_timeout(2500)
        assert sideways(page) <= 0
        picture(page, "telephone-live", whole=True)
        page.get_by_role("button", name="Stop …").click()
        assert sideways(page) <= 0
        picture(page, "telephone-stop-dialog")
        page.get_by_role("button", name="Let it run").click()
        expect(page.get_by_role("dialog")).to_have_count(0)
        page.get_by_role("button", name="Stop …").click()
        hold = page.get_by_role("button", name=re.compile("hold for 2 s"))
        hold.hover()
        page.mouse.down()
        page.wait_for_timeout(500)
        assert hold.evaluate("node => getComputedStyle(node, '::after').transitionDuration") == "0s"
        page.mouse.up()  # too short
        page.wait_for_timeout(2200)
        expect(page.get_by_role("dialog")).to_be_visible()
        page.mouse.down()
        page.wait_for_timeout(2300)
        page.mouse.up()
        expect(page.locator(".banner").filter(has_text="The run has ended: interrupted")).to_be_visible(timeout=30_000)


def test_who_only_looks_has_no_stop_and_a_dead_run_is_told_with_what_to_do(
    browser: Browser, lab: Lab, served: Served
) -> None:
    with a_page(browser, served.url) as seen:
        page = seen.page
        watch(page, served, served.view_token)
        until(page, "static")
        expect(page.get_by_text("looks only")).to_be_visible()
        expect(page.get_by_role("button", name="Stop …")).to_have_count(0)
        lab.end()
        banner = page.get_by_role("alert").filter(has_text="The runner has died.")
        expect(banner).to_be_visible(timeout=20_000)
        expect(banner).to_contain_text(f"benchctl recover {NAME}")
        expect(banner).to_contain_text(f"benchctl run swings --resume {NAME}")
        page.wait_for_timeout(1500)
        picture(page, "died-light")
        page.keyboard.press("Escape")
        expect(page.locator(".chip").filter(has_text="died")).to_be_visible()


def test_the_live_page_goes_on_by_itself_when_the_server_was_away(browser: Browser, lab: Lab, served: Served) -> None:
    with a_page(browser, served.url) as seen:
        seen.forgiven = ("ERR_INTERNET_DISCONNECTED",)
        page = seen.page
        watch(page, served, served.token)
        until(page, "static")
        page.context.set_offline(True)
        alert = page.get_by_role("alert").filter(has_text="The server does not answer")
        expect(alert).to_be_visible(timeout=20_000)
        picture(page, "server-away-light")
        before_s = bench_time_s(page)
        page.context.set_offline(False)
        expect(alert).to_have_count(0)
        page.wait_for_timeout(2000)
        assert bench_time_s(page) > before_s + 10
