"""The handbook on the page: topics, links, anchors, the search, and how it looks in both themes."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from benchctl.app.handbook import title_of, topics
from tests.benchctl.dashboard.page.browsing import TELEPHONE, Seen, Served, a_page, picture, serving, sideways

DESK = (1440, 900)
LOOKS = pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
SIZES = pytest.mark.parametrize(("size", "name"), [(DESK, "desk"), (TELEPHONE, "telephone")], ids=["desk", "telephone"])


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A server without campaigns: the handbook needs none."""
    with serving(tmp_path_factory.mktemp("campaigns"), tmp_path_factory.mktemp("cache")) as server:
        yield server


@pytest.fixture
def seen(browser: Browser, served: Served) -> Iterator[Seen]:
    """The list of topics, reached by the header."""
    with a_page(browser, served.url, DESK) as seen:
        log_in(seen.page, served)
        seen.page.get_by_role("link", name="Help", exact=True).click()
        expect(seen.page.get_by_role("heading", name="Handbook", exact=True)).to_be_visible()
        yield seen


def log_in(page: Page, served: Served) -> None:
    page.goto(f"{served.url}#{served.token}")
    expect(page.get_by_text("No campaign is here yet")).to_be_visible()


def test_every_topic_is_listed_and_opens(seen: Seen) -> None:
    page = seen.page
    titles = [title_of(text) for text in topics().values()] + ["Terms"]
    assert page.locator(".contents > li > a").all_inner_texts() == titles
    for title in titles:
        page.locator(".help nav").get_by_role("link", name=title, exact=True).click()
        expect(page.get_by_role("heading", level=1, name=title, exact=True)).to_be_visible()
        words = page.locator(".help-body > :not(pre)").all_inner_texts()
        assert not [one for one in words if "**" in one or "](" in one]  # nothing is left as Markdown


def test_a_page_has_its_tables_and_its_code(seen: Seen) -> None:
    page = seen.page
    page.locator(".contents").get_by_role("link", name="Your own bench").click()
    expect(page.locator(".help-body table")).to_have_count(3)
    expect(page.locator(".help-body td code", has_text="acutrol3000")).to_be_visible()
    blocks = re.findall(r"^```\w*\n(.*?)^```", topics()["your_bench"], re.M | re.S)
    assert page.locator(".help-body pre").all_text_contents() == blocks
    assert page.locator(".help-body a[href*='.md']").count() == 0  # what is not installed is no link


def test_a_link_leads_to_another_page_a_heading_to_itself_and_back_leads_back(seen: Seen) -> None:
    page = seen.page
    page.locator(".contents").get_by_role("link", name="Calibration").click()
    page.locator(".help-body p").get_by_role("link", name="diagnosis").click()
    expect(page.get_by_role("heading", level=1, name="Diagnosis")).to_be_visible()
    page.locator(".help nav").get_by_role("link", name="Limits").click()
    expect(page).to_have_url(re.compile("#/help/diagnosis/limits$"))
    expect(page.get_by_role("heading", name="Limits")).to_be_in_viewport()
    page.reload()
    expect(page.get_by_role("heading", name="Limits")).to_be_in_viewport()
    page.go_back()
    page.go_back()
    expect(page.get_by_role("heading", level=1, name="Calibration")).to_be_visible()


def test_a_search_finds_the_passage_and_leads_to_it(seen: Seen) -> None:
    page = seen.page
    page.keyboard.press("/")
    page.keyboard.type("steady guard band")
    expect(page.get_by_text("No passage has these words")).to_be_visible()
    page.get_by_label("Search the handbook").fill("GUARD killed hangs")
    found = page.locator(".passages > li")
    expect(found.first).to_contain_text("Your own bench › Unattended runs")
    expect(found.first.locator("p")).to_contain_text("brings table and chamber to rest")
    expect(found.first.locator("p mark").first).to_have_text("Guard")
    page.keyboard.press("Enter")
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", name="Unattended runs")).to_be_in_viewport()
    page.go_back()
    expect(page.get_by_label("Search the handbook")).to_have_value("GUARD killed hangs")
    expect(found.first).to_contain_text("Unattended runs")
    page.get_by_label("Search the handbook").fill("")
    expect(page.get_by_role("heading", name="Handbook", exact=True)).to_be_visible()


def test_terms_are_explained_and_lead_to_each_other(seen: Seen) -> None:
    page = seen.page
    page.get_by_label("Search the handbook").fill("thermal lag")
    page.locator(".passages").get_by_role("link", name="Terms › thermal lag").click()
    heading = page.get_by_role("heading", name="thermal lag", exact=True)
    expect(heading).to_be_in_viewport()
    page.locator("h3:has(a:text-is('thermal lag')) ~ p a").first.click()
    expect(page).to_have_url(re.compile("#/help/terms/(?!thermal-lag$)"))


def test_help_addresses_lead_to_the_view_after_the_log_in_too(browser: Browser, served: Served) -> None:
    with a_page(browser, served.url) as seen:
        page = seen.page
        page.goto(f"{served.url}help/ci/gitlab")
        page.get_by_label("Token").fill(served.view_token)
        page.keyboard.press("Enter")
        expect(page.get_by_role("heading", name="GitLab")).to_be_in_viewport()
        page.goto(f"{served.url}help/nothing")
        expect(page.get_by_text("There is no page nothing in the handbook")).to_be_visible()
        expect(page.locator(".contents > li")).to_have_count(len(topics()) + 1)


@LOOKS
@SIZES
def test_it_fits_the_screen_in_both_themes(
    browser: Browser, served: Served, size: tuple[int, int], name: str, dark: bool
) -> None:
    with a_page(browser, served.url, size, dark=dark) as seen:
        page = seen.page
        log_in(page, served)
        for view, what in (("", "topics"), ("/your_bench", "bench"), ("/terms", "terms"), ("?q=chamber", "search")):
            page.goto(f"{served.url}#/help{view}")
            expect(page.locator(".help-body")).not_to_be_empty()
            assert sideways(page) <= 0, view
            picture(page, f"help-{what}-{name}-{'dark' if dark else 'light'}")
