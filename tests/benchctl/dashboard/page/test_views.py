"""What views show to a person: one clock, what a soak waits for, verdicts on a telephone, ticks on every axis."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from benchctl.bench import load_bench
from benchctl.campaign.soak import SOAK_CHANNELS, one_poll
from benchctl.recordings.campaign_folder import CampaignWriter, StepWriter
from benchctl.recordings.campaign_manifest import add_to_manifest, write_manifest
from benchctl.recordings.model import Step
from benchctl_instruments.interfaces import ChamberReading
from tests.benchctl.dashboard.page.browsing import TELEPHONE, Served, a_page, picture, serving, sideways
from tests.benchctl.history.made_history import accepted, digest_in, one_test
from tests.benchctl.recordings import made

pytestmark = pytest.mark.timeout(180)

DESK = (1440, 900)
SIZES = pytest.mark.parametrize(("size", "name"), [(DESK, "1440"), (TELEPHONE, "390")], ids=["desk", "telephone"])
LOOKS = pytest.mark.parametrize(
    ("size", "name", "dark"),
    [
        pytest.param(DESK, "1440", False, id="desk, light"),
        pytest.param(TELEPHONE, "390", True, id="telephone, dark"),
        pytest.param(DESK, "1440", True, id="desk, dark", marks=pytest.mark.slow),
        pytest.param(TELEPHONE, "390", False, id="telephone, light", marks=pytest.mark.slow),
    ],
)
"""Where a thing stands is a matter of the size: each is looked at in one theme by default, in both slowly."""
RUNNING, OVER, FORGED = "soaking_SN-1", "over_SN-1", "forged_SN-1"
TESTS = (
    ("bias_stability", "deg/h", 1.15, "PASS"),
    ("angle_random_walk", "deg/sqrt(h)", 0.0123, "FAIL"),
    ("scale_factor_nonlinearity", "ppm", 118.0, "INCONCLUSIVE"),
    ("temperature_sensitivity_of_the_bias", "deg/h/degC", 0.42, None),
)


class Soaking:
    """A campaign that runs: a turn of 60 s that took 110 s is over, a soak is played, a turn is to come."""

    def __init__(self, folder: Path) -> None:
        bench = load_bench("simulated")
        told = {"bench_toml": bench.text, "chamber_profile": bench.chamber_profile, "procedure": "two_stage"}
        self.writer = CampaignWriter(folder, made.meta(status="running", provenance=told))
        self.writer.event("prepared", planned=3, bench_s=0.0)
        self.writer.event("plan", bench_s=0.0, of=3, steps=_plan())
        self._play(1, "rate +50", 5.0)
        first = made.step(1, rows=3000, t_start=80.0, rate_dps=50.0)
        into = self.writer.begin_step(first.info, tuple(first.channels))
        into.append(first.channels)
        self.writer.step_over(into.close(first.info))
        self._play(2, "soak at +35", 115.0)
        self._soak: StepWriter = self.writer.begin_step(
            made.info(2, name="soak at +35", kind="soak", t_start=115.0, chamber_setpoint_c=35.0), SOAK_CHANNELS
        )

    def poll(self, time_s: float, air_c: float, gyro_c: float) -> None:
        """One look at the chamber and the gyro."""
        air = ChamberReading(temperature_c=air_c, setpoint_c=35.0, power_percent=0.0)
        self._soak.append_point(one_poll(time_s, air, {"poll_gyro_temp_c": gyro_c, "poll_gyro_v": 2.5}))
        self._soak.flush()

    def _play(self, number: int, name: str, bench_s: float) -> None:
        self.writer.event("step", bench_s=bench_s, index=number, number=number, name=name)


def _plan() -> list[dict[str, Any]]:
    steps = (
        ("rate +50", "constant_rate", 60.0, 25.0),
        ("soak at +35", "soak", 600.0, 35.0),
        ("sine", "sine", 340.0, 35.0),
    )
    planned, now_s = [], 0.0
    for index, (label, kind, lasts_s, setpoint_c) in enumerate(steps, 1):
        soak = {"hold_s": 300.0, "tolerance_c": 0.3, "drift_c_per_min": 0.02} if kind == "soak" else {}
        times = {"t_start_s": now_s, "t_end_s": now_s + lasts_s, "streamed_s": 0.0, "setpoint_c": setpoint_c}
        planned.append({"index": index, "label": label, "kind": kind, **times, **soak})
        now_s += lasts_s
    return planned


def _turn(index: int, rate_dps: float) -> Step:
    """A step in which the table turns at a rate [°/s]."""
    step = made.step(index, rows=3000, t_start=40.0 * index, rate_dps=rate_dps)
    angle_deg = np.mod(rate_dps * step["time_s"], 360.0)
    return Step(step.info, {**step.channels, "encoder_deg": angle_deg})


def finished(folder: Path, value: float = 1.15) -> Path:
    """A campaign that is over, with turns at several rates, and accepted."""
    writer = CampaignWriter(folder, made.meta(status="running"))
    for index, rate_dps in enumerate((42.5, -42.5, 95.0, -95.0), 1):
        step = _turn(index, rate_dps)
        into = writer.begin_step(step.info, tuple(step.channels))
        into.append(step.channels)
        writer.step_over(into.close(step.info))
    writer.finish("complete")
    write_manifest(folder)
    limit = {"low": None, "high": 3.0, "unit": "deg/h"}
    tests = [
        one_test(
            name, value=value, unit=unit, verdict=verdict, limit=limit if verdict else None, remedy="measure longer"
        )
        for name, unit, value, verdict in TESTS
    ]
    (folder / "acceptance.json").write_text(accepted(tests, digest_in(folder), verdict="FAIL"))
    add_to_manifest(folder, [folder / "acceptance.json"])
    return folder


@pytest.fixture(scope="module")
def soaking(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Soaking]:
    """A folder with a campaign in a soak, one that is over, and one whose acceptance was altered."""
    root = tmp_path_factory.mktemp("campaigns")
    finished(root / OVER)
    forged = finished(root / FORGED) / "acceptance.json"
    forged.write_text(forged.read_text().replace("FAIL", "PASS"))
    soaking = Soaking(root / RUNNING)
    yield soaking
    soaking.writer.release()


@pytest.fixture(scope="module")
def served(soaking: Soaking, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A server before them."""
    with serving(soaking.writer.folder.parent, tmp_path_factory.mktemp("cache")) as server:
        yield server


def open_page(page: Page, served: Served, name: str, tab: str) -> None:
    """Log in and go to a page of a campaign; that of one that runs is shown first."""
    page.goto(f"{served.url}#{served.view_token}")
    page.locator(".campaigns a", has=page.get_by_text(name, exact=True)).click()
    if tab != "Live":
        page.get_by_role("link", name=tab, exact=True).click()


def is_inside(page: Page, selector: str) -> list[bool]:
    """Whether the things of a selector lie between the left and the right edge of the window, each."""
    found: list[bool] = page.locator(selector).evaluate_all(
        "nodes => nodes.map(node => node.getBoundingClientRect())"
        ".map(box => box.width > 0 && box.left >= 0 && box.right <= window.innerWidth)"
    )
    return found


def seconds(text: str) -> int:
    """A clock, h:mm:ss, in seconds."""
    hours, minutes, rest = text.split(":")
    return 3600 * int(hours) + 60 * int(minutes) + int(rest)


@LOOKS
def test_the_live_page_has_one_clock_and_says_what_a_soak_waits_for(
    browser: Browser, served: Served, soaking: Soaking, size: tuple[int, int], name: str, dark: bool
) -> None:
    begin_s = soaking_from(soaking)
    with a_page(browser, served.url, size, dark=dark) as seen:
        page = seen.page
        open_page(page, served, RUNNING, "Live")
        waits = page.locator(".waits")
        soaking.poll(begin_s + 30.0, 33.0, 31.0)
        expect(waits).to_contain_text("Waiting for the chamber: air 33.00 → 35.0")
        expect(waits).to_contain_text("5\u202fmin within ±0.3")
        soaking.poll(begin_s + 60.0, 34.9, 33.0)
        soaking.poll(begin_s + 130.0, 35.1, 34.0)
        expect(waits).to_contain_text("Soaking: air 35.10, set point 35.0")
        expect(waits).to_contain_text("for 1\u202fmin 10\u202fs of 5\u202fmin, 3\u202fmin 50\u202fs left")
        assert is_inside(page, ".waits") == [True]
        assert_one_clock(page, now_s=begin_s + 130.0)
        picture(page, f"soak-{name}-{'dark' if dark else 'light'}", whole=True)
        assert sideways(page) <= 0
        soaking.poll(begin_s + 360.0, 35.0, 35.0)
        expect(waits).to_contain_text("Waiting for the gyro: gyro drifts by")
        expect(waits).to_contain_text("at most 0.02\u202f°C/min is allowed")
        assert_one_clock(page, now_s=begin_s + 360.0)


def soaking_from(soaking: Soaking) -> float:
    """The last poll so far; whoever comes next begins outside the tolerance."""
    soaking.begin_s = getattr(soaking, "begin_s", 115.0) + 400.0
    return soaking.begin_s


def assert_one_clock(page: Page, now_s: float) -> None:
    """Figures, progress and the cursor of the timeline state the same bench time, elapsed and left make the whole."""
    expect(page.locator(".ends")).to_contain_text(f"bench time {clock(now_s)} of")
    found = re.search(r"bench time ([\d:]+) of ([\d:]+) · ([\d:]+) left", page.locator(".ends").inner_text())
    assert found
    elapsed_s, total_s, left_s = map(seconds, found.groups())
    assert elapsed_s + left_s == total_s
    assert f"longer than planned ({clock(1000.0)})" in page.locator(".ends").inner_text()
    assert float(page.locator(".doing progress").evaluate("node => node.value")) == pytest.approx(
        elapsed_s / total_s, abs=0.01
    )
    cursor, last, first = page.locator(".timeline").evaluate(
        """drawing => {
            const boxes = [...drawing.querySelectorAll("rect:not(.window)")].map((box) => box.getBoundingClientRect());
            return [
                drawing.querySelector("line.now").getBoundingClientRect().left,
                Math.max(...boxes.map((box) => box.right)),
                Math.min(...boxes.map((box) => box.left)),
            ];
        }"""
    )
    begins = 5.0 / total_s  # the first step began then
    assert (cursor - first) / (last - first) == pytest.approx((elapsed_s / total_s - begins) / (1 - begins), abs=0.01)


def clock(seconds: float) -> str:
    return f"{int(seconds) // 3600}:{int(seconds) // 60 % 60:02d}:{int(seconds) % 60:02d}"


@LOOKS
def test_every_axis_of_a_finished_campaign_has_at_least_three_ticks(
    browser: Browser, served: Served, size: tuple[int, int], name: str, dark: bool
) -> None:
    with a_page(browser, served.url, size, dark=dark) as seen:
        page = seen.page
        open_page(page, served, OVER, "Plots")
        expect(page.locator(".zoom")).to_have_attribute("aria-busy", "false")
        picture(page, f"plots-{name}-{'dark' if dark else 'light'}", whole=True)
        assert_ticks(page)
        for key, times in (("+", 4), ("ArrowRight", 3), ("+", 8)):
            for _ in range(times):
                page.keyboard.press(key)
            expect(page.locator(".zoom")).to_have_attribute("aria-busy", "false")
            assert_ticks(page)
        open_page(page, served, RUNNING, "Live")
        expect(page.locator(".where")).to_contain_text("Step 2 of 3")
        expect(page.locator(".plot")).to_have_count(3)
        assert_ticks(page)


def assert_ticks(page: Page) -> None:
    expect(page.locator('.plot[data-value-ticks]:not([data-value-ticks="0"])').first).to_be_visible()
    plots = page.locator(".plot").evaluate_all("plots => plots.map(({ dataset }) => ({ ...dataset }))")
    assert plots
    for plot in plots:
        assert int(plot["timeTicks"]) >= 3, plots
        assert int(plot["valueTicks"]) >= 3 or int(plot["valueTicks"]) == 0, plots  # 0: nothing is drawn
    assert any(int(plot["valueTicks"]) for plot in plots)
    assert page.locator(".timeline text").filter(has_text=re.compile(r"^\d+:\d\d")).count() >= 3


@LOOKS
def test_verdicts_of_an_acceptance_are_on_the_screen(
    browser: Browser, served: Served, size: tuple[int, int], name: str, dark: bool
) -> None:
    with a_page(browser, served.url, size, dark=dark) as seen:
        page = seen.page
        open_page(page, served, OVER, "Acceptance")
        expect(page.locator("tbody tr")).to_have_count(len(TESTS))
        expect(page.locator("p.verdict .chip")).to_be_visible()
        picture(page, f"acceptance-{name}-{'dark' if dark else 'light'}", whole=True)
        assert is_inside(page, "p.verdict .chip") == [True]
        assert is_inside(page, "tbody .chip") == [True] * 3
        assert is_inside(page, "tbody th") == [True] * 4
        assert sideways(page) <= 0


@SIZES
def test_an_altered_campaign_is_marked_in_the_list_and_on_each_of_its_pages(
    browser: Browser, served: Served, size: tuple[int, int], name: str
) -> None:
    with a_page(browser, served.url, size) as seen:
        page = seen.page
        page.goto(f"{served.url}#{served.view_token}")
        row = page.locator(".campaigns li", has=page.get_by_text(FORGED, exact=True))
        expect(row).to_contain_text("altered")
        expect(row).to_contain_text("acceptance.json")
        expect(page.locator(".campaigns li", has=page.get_by_text(OVER, exact=True))).not_to_contain_text("altered")
        picture(page, f"list-altered-{name}", whole=True)
        for tab in ("Plots", "Acceptance", "About"):
            open_page(page, served, FORGED, tab)
            expect(page.get_by_role("alert").filter(has_text="Altered. acceptance.json")).to_be_visible()
        assert sideways(page) <= 0
        picture(page, f"altered-{name}", whole=True)


def test_the_data_of_these_tests_is_what_they_say(soaking: Soaking) -> None:
    document = json.loads((soaking.writer.folder.parent / OVER / "acceptance.json").read_text())
    assert [test["verdict"] for test in document["tests"]] == [verdict for *_, verdict in TESTS]
