"""The page before campaigns that are over: log-in, list, plots, documents, themes, names that strangers chose."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, Route, expect

from tests.benchctl.dashboard.page.browsing import TELEPHONE, Seen, Served, a_page, picture, serving, sideways
from tests.benchctl.dashboard.page.conftest import EVIL, REST, TURNS

pytestmark = pytest.mark.timeout(180)  # three programs start for the first of these tests


@pytest.fixture
def seen(browser: Browser, served: Served) -> Iterator[Seen]:
    """A page of an operator who has logged in."""
    with a_page(browser, served.url) as seen:
        seen.page.goto(f"{served.url}#{served.token}")
        expect(seen.page.locator(".campaigns > li")).to_have_count(4)
        yield seen


def open_campaign(page: Page, name: str, tab: str = "") -> None:
    """From the list to a page of a campaign."""
    page.locator(".campaigns a", has=page.get_by_text(name, exact=True)).click()
    if tab:
        page.get_by_role("link", name=tab, exact=True).click()


def drawn(page: Page) -> None:
    """Wait until a plot shows what was asked for."""
    expect(page.locator(".zoom")).to_have_attribute("aria-busy", "false")


def window_of(page: Page) -> tuple[float, float]:
    """The window that the address keeps."""
    found = re.search(r"from=([\d.e-]+)&to=([\d.e-]+)", page.url)
    assert found, page.url
    return float(found[1]), float(found[2])


def test_a_token_in_the_address_logs_in_and_leaves_address_and_history(browser: Browser, served: Served) -> None:
    with a_page(browser, served.url) as seen:
        seen.page.goto(f"{served.url}#{served.token}")
        expect(seen.page.get_by_role("heading", name="Campaigns")).to_be_visible()
        assert served.token not in seen.page.url
        seen.page.reload()  # the session's cookie is enough
        expect(seen.page.get_by_role("heading", name="Campaigns")).to_be_visible()
        seen.page.go_back()
        assert served.token not in seen.page.url
        assert served.token not in seen.page.content()


def test_a_wrong_token_says_so_and_the_right_one_logs_in_and_out(browser: Browser, served: Served) -> None:
    with a_page(browser, served.url) as seen:
        seen.forgiven = ("401 (Unauthorized)",)
        page = seen.page
        page.goto(served.url)
        page.get_by_label("Token").fill("not-the-token")
        page.get_by_role("button", name="Log in").click()
        expect(page.get_by_role("alert").filter(has_text="not the server's")).to_be_visible()
        page.get_by_label("Token").fill(served.token)
        page.keyboard.press("Enter")
        expect(page.get_by_text("may stop runs")).to_be_visible()
        page.get_by_role("button", name="Log out").click()
        expect(page.get_by_label("Token")).to_be_visible()
        page.reload()
        expect(page.get_by_label("Token")).to_be_visible()


def test_a_campaign_that_a_busy_server_refuses_is_asked_for_again(seen: Seen) -> None:
    seen.forgiven = ("503 (Service Unavailable)",)
    refused: list[str] = []

    def refuse_once(route: Route) -> None:
        url = route.request.url
        if url in refused:
            route.continue_()
        else:
            refused.append(url)
            route.fulfill(status=503, headers={"retry-after": "1"}, json={"error": "too many requests at once"})

    seen.page.route("**/api/campaigns/*", refuse_once)
    open_campaign(seen.page, TURNS)
    expect(seen.page.get_by_role("link", name="Plots", exact=True)).to_be_visible()
    assert refused


def test_the_list_is_searched_and_walked_through_by_keys(seen: Seen) -> None:
    page = seen.page
    picture(page, "list-light")
    expect(page.locator(".chip").filter(has_text="complete")).to_have_count(3)
    expect(page.locator("li", has_text="torn")).to_contain_text("unreadable")
    assert str(page.locator(".campaigns time").first.get_attribute("title")).endswith("UTC")
    page.keyboard.press("/")
    page.keyboard.type("turns")
    expect(page.locator(".campaigns > li")).to_have_count(1)
    expect(page.get_by_text("1 of 4 campaigns")).to_be_visible()
    page.keyboard.press("Enter")
    expect(page.locator(".campaigns a").first).to_be_focused()
    page.get_by_label("Search").fill("")
    page.keyboard.press("Escape")
    for key, index in (("j", 0), ("ArrowDown", 1), ("j", 2), ("k", 1)):
        page.keyboard.press(key)
        expect(page.locator(".campaigns a").nth(index)).to_be_focused()
    outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
    assert outline == "solid"  # whoever uses keys sees where they are
    page.keyboard.press("Enter")
    drawn(page)
    page.keyboard.press("?")
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("zoom in")
    expect(dialog).to_contain_text("back to the campaigns")
    page.keyboard.press("Escape")
    expect(dialog).to_have_count(0)
    page.keyboard.press("Escape")
    expect(page.get_by_role("heading", name="Campaigns")).to_be_visible()


def test_a_recording_is_zoomed_by_drag_wheel_and_keys_down_to_single_samples(seen: Seen) -> None:
    page = seen.page
    open_campaign(page, REST)
    drawn(page)
    said = page.locator(".zoom > .how")
    expect(said).to_contain_text("minimum and maximum of")
    picture(page, "finished-light")
    over = page.locator(".u-over").first
    box = over.bounding_box()
    assert box
    page.mouse.move(box["x"] + 0.975 * box["width"], box["y"] + 40)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.995 * box["width"], box["y"] + 60, steps=4)
    page.mouse.up()
    drawn(page)
    first, last = window_of(page)
    whole_s = last / 0.995
    assert first == pytest.approx(0.975 * whole_s, rel=0.005)

    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 40)
    for _ in range(40):
        page.mouse.wheel(0, -240)
        page.wait_for_timeout(10)
        if window_of(page)[1] - window_of(page)[0] < 0.25:
            break
    assert window_of(page)[1] - window_of(page)[0] < 0.25
    assert sum(window_of(page)) / 2 == pytest.approx((first + last) / 2, abs=0.05 * (last - first))
    expect(said).to_contain_text("exact: each of the")
    drawn(page)
    picture(page, "zoomed-to-samples-light")
    assert 80 < dots_of(page) < 130  # 500 samples a second

    before = window_of(page)
    page.keyboard.press("ArrowRight")
    drawn(page)
    assert window_of(page)[0] == pytest.approx(before[0] + 0.25 * (before[1] - before[0]))
    page.keyboard.press("Backspace")
    assert window_of(page) == pytest.approx(before)
    page.keyboard.press("+")
    drawn(page)
    assert window_of(page)[1] - window_of(page)[0] == pytest.approx((before[1] - before[0]) / 2)
    page.reload()  # the address leads back to the same view
    drawn(page)
    assert window_of(page)[1] - window_of(page)[0] == pytest.approx((before[1] - before[0]) / 2)
    page.keyboard.press("0")
    drawn(page)
    expect(said).to_contain_text("minimum and maximum of")


def dots_of(page: Page) -> int:
    """How many separate dots of the first line's colour lie on the first plot, in one row through its middle third."""
    found: int = page.evaluate(
        """() => {
          const canvas = document.querySelector(".u-wrap canvas");
          const { data, width, height } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
          const columns = new Array(width).fill(0);
          for (let y = 0; y < height; y += 1) for (let x = 0; x < width; x += 1) {
            const at = 4 * (y * width + x);
            const [red, green, blue, alpha] = data.slice(at, at + 4);
            if (alpha > 200 && red < 40 && green > 90 && green < 130 && blue > 150) columns[x] += 1;
          }
          const isPeak = (many, x) => many >= 4 && columns[x - 1] < many && columns[x + 1] <= many;
          return columns.filter(isPeak).length;
        }"""
    )
    return found


@pytest.mark.slow
def test_a_step_in_the_table_is_shown_when_it_is_chosen(seen: Seen) -> None:
    page = seen.page
    open_campaign(page, TURNS)
    drawn(page)
    row = page.locator(".steps tbody tr", has_text="rate +42.5")
    expect(row).to_contain_text("constant rate")
    row.get_by_role("button").click()
    drawn(page)
    began, ended = window_of(page)
    assert 10 < ended - began < 60
    page.get_by_text("encoder_deg", exact=True).click()
    expect(page.locator(".panel")).to_have_count(4)
    drawn(page)
    assert "encoder_deg" in page.url


def test_names_that_are_markup_are_shown_as_text(seen: Seen) -> None:
    page = seen.page
    name = EVIL.replace("/", "")
    expect(page.locator(".campaigns b", has_text="onerror").first).to_have_text(name)
    open_campaign(page, name)
    drawn(page)
    expect(page.locator("h1")).to_have_text(name)
    expect(page.locator(".steps tbody")).to_contain_text("<img src=x")
    page.locator(".timeline").hover(position={"x": 400, "y": 50})
    for tab in ("Events", "About"):
        page.get_by_role("link", name=tab, exact=True).click()
        expect(page.locator(f".page.{tab.lower()}")).to_be_visible()
    page.get_by_role("link", name="History", exact=True).click()
    expect(page.get_by_role("heading", name="Units over time")).to_be_visible()
    expect(page.locator(".unit-card").first).to_be_visible()
    page.get_by_role("link", name="Compare", exact=True).click()
    expect(page.locator("select").first).to_be_visible()
    assert page.locator("main img").count() == 0
    assert page.title() != "owned"


@pytest.mark.slow
def test_two_campaigns_are_compared_by_time_and_by_step_and_their_differences_told(seen: Seen) -> None:
    page = seen.page
    for name in (REST, TURNS):
        page.get_by_label(f"compare {name}").check()
    page.get_by_role("button", name="Compare these two").click()
    drawn(page)
    expect(page.locator(".panel .legend")).to_have_count(2)
    expect(page.get_by_role("region", name=re.compile("steps are alike"))).to_contain_text("only in B")
    picture(page, "compare-light", whole=True)
    page.get_by_label("Aligned by").select_option(label="step 1, soak at +20: both from its beginning")
    drawn(page)
    expect(page.locator(".bar .span")).to_contain_text("0:00:00")
    assert "step=1" in page.url


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.slow
def test_the_theme_follows_the_system_until_somebody_chooses_and_the_choice_is_kept(
    browser: Browser, served: Served, dark: bool
) -> None:
    with a_page(browser, served.url, dark=dark) as seen:
        page = seen.page
        page.goto(f"{served.url}#{served.token}")
        expect(page.locator(".campaigns > li")).to_have_count(4)
        assert is_dark(page) is dark
        page.get_by_role("button", name="dark or light").click()
        assert is_dark(page) is not dark
        page.reload()
        expect(page.locator(".campaigns > li")).to_have_count(4)
        assert is_dark(page) is not dark
        open_campaign(page, TURNS)
        drawn(page)
        picture(page, f"finished-{'light' if dark else 'dark'}-chosen")


def is_dark(page: Page) -> bool:
    """Whether the paper is darker than the ink."""
    red = page.evaluate("getComputedStyle(document.documentElement).backgroundColor.match(/\\d+/)[0]")
    return int(red) < 128


def test_nothing_is_wider_than_a_telephone(browser: Browser, served: Served) -> None:
    with a_page(browser, served.url, TELEPHONE, dark=True) as seen:
        page = seen.page
        page.goto(f"{served.url}#{served.token}")
        expect(page.locator(".campaigns > li")).to_have_count(4)
        assert sideways(page) <= 0
        picture(page, "telephone-list")
        open_campaign(page, TURNS)
        drawn(page)
        assert sideways(page) <= 0
        picture(page, "telephone-finished", whole=True)
        for tab in ("Events", "About"):
            page.get_by_role("link", name=tab, exact=True).click()
            expect(page.locator(f".page.{tab.lower()} > *").first).to_be_visible()
            assert sideways(page) <= 0, tab
        for place in ("History", "Compare"):
            page.get_by_role("link", name=place, exact=True).click()
            expect(page.get_by_role("heading", level=1)).to_be_visible()
            assert sideways(page) <= 0, place


@pytest.mark.slow
def test_a_finger_moves_a_plot_and_two_widen_it(browser: Browser, served: Served) -> None:
    with a_page(browser, served.url, TELEPHONE) as seen:
        page = seen.page
        page.goto(f"{served.url}#{served.token}")
        open_campaign(page, REST)
        drawn(page)
        page.get_by_role("button", name="the whole recording").click()
        whole_s = window_of(page)[1]
        box = page.locator(".u-over").first.bounding_box()
        assert box
        middle, height = box["x"] + box["width"] / 2, box["y"] + 30
        pinch(page, [(middle - 20, middle + 20), (middle - 60, middle + 60), (middle - 80, middle + 80)], height)
        drawn(page)
        began, ended = window_of(page)
        assert ended - began == pytest.approx(whole_s / 4, rel=0.05)
        pinch(page, [(middle,), (middle - 40,)], height)
        drawn(page)
        assert window_of(page)[0] > began


def pinch(page: Page, places: list[tuple[float, ...]], height: float) -> None:
    """Fingers put down at the first places, moved through the others, and lifted."""
    session = page.context.new_cdp_session(page)
    for number, xs in enumerate(places):
        points = [{"x": x, "y": height, "id": finger} for finger, x in enumerate(xs)]
        session.send(
            "Input.dispatchTouchEvent", {"type": "touchMove" if number else "touchStart", "touchPoints": points}
        )
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def test_a_server_out_of_reach_is_told_and_found_again_by_itself(seen: Seen) -> None:
    seen.forgiven = ("ERR_INTERNET_DISCONNECTED",)
    page = seen.page
    page.context.set_offline(True)
    open_campaign(page, TURNS)
    alert = page.get_by_role("alert").filter(has_text="The server does not answer")
    expect(alert).to_be_visible()
    expect(alert).to_contain_text("Trying again in")
    picture(page, "unreachable-light")
    page.context.set_offline(False)
    expect(alert).to_have_count(0)
    expect(page.get_by_text("The server answers again.")).to_be_visible()
    drawn(page)


@pytest.mark.slow
def test_a_server_that_started_anew_asks_for_its_new_token(browser: Browser, campaigns: Path, tmp_path: Path) -> None:
    with serving(campaigns, tmp_path) as first:
        port = int(first.url.rstrip("/").rpartition(":")[2])
        context = a_page(browser, first.url)
        seen = context.__enter__()
        seen.page.goto(f"{first.url}#{first.token}")
        expect(seen.page.locator(".campaigns > li")).to_have_count(4)
    seen.forgiven = ("ERR_CONNECTION_REFUSED", "ERR_EMPTY_RESPONSE", "ERR_CONNECTION_RESET", "401 (Unauthorized)")
    with serving(campaigns, tmp_path, port=port):
        expect(seen.page.get_by_role("alert").filter(has_text="The session is over")).to_be_visible()
        expect(seen.page.get_by_label("Token")).to_be_visible()
        context.__exit__(None, None, None)
