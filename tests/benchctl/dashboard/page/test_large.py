"""A recording of twenty million samples: what is missing says so and appears by itself, and zooming stays quick."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, expect

from tests.benchctl.dashboard.page.browsing import Served, a_page, picture, serving

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

_SECONDS = 40_000
_QUICK = 0.25
"""Median time from a key to the drawn view over that of the overview, which reads every sample once."""


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A server before one long rest, 500 scans a second."""
    root = tmp_path_factory.mktemp("campaigns")
    made = ("simulate", "static", "-p", "soak_s=60", "-p", f"duration_s={_SECONDS}", "-o", root / "long.h5")
    subprocess.run([sys.executable, "-m", "benchctl", *map(str, made), "--seed", "3", "--quiet"], check=True)
    with serving(root, tmp_path_factory.mktemp("cache")) as server:
        yield server


def test_a_long_recording_is_shown_while_its_overview_is_made_and_zoomed_quickly(
    browser: Browser, served: Served
) -> None:
    with a_page(browser, served.url) as seen:
        page = seen.page
        page.goto(f"{served.url}#{served.token}")
        began_s = time.monotonic()
        page.locator(".campaigns a").click()
        said = page.locator(".zoom > .how")
        expect(said).to_contain_text("the overview is being made")
        picture(page, "overview-being-made-light")
        expect(said).not_to_contain_text("being made", timeout=120_000)
        overview_ms = 1e3 * (time.monotonic() - began_s)
        picture(page, "long-light")
        took_ms = []
        for key in ["+"] * 16 + ["ArrowRight"] * 4 + ["-"] * 8:
            page.locator(".zoom").evaluate("node => delete node.dataset.drawnMs")
            page.keyboard.press(key)
            expect(page.locator(".zoom[data-drawn-ms]")).to_have_count(1)
            took_ms.append(float(page.locator(".zoom").get_attribute("data-drawn-ms") or "nan"))
        median_ms = statistics.median(took_ms)
        sys.stdout.write(f"overview {overview_ms:.0f} ms, zoomed: median {median_ms:.0f} ms\n")
        assert median_ms < _QUICK * overview_ms
