"""Who may ask, over real sockets."""

import pytest

from tests.benchctl.dashboard.web.serving import Served

PRIVATE = (
    "/api/campaigns",
    "/api/campaigns/0123456789abcdef",
    "/api/campaigns/0123456789abcdef/series?channel=gyro_v&from_s=0&to_s=1",
    "/api/campaigns/0123456789abcdef/events",
    "/api/campaigns/0123456789abcdef/documents/diagnosis",
    "/api/campaigns/0123456789abcdef/documents/diagnosis/report",
    "/api/released",
    "/api/queue",
    "/api/history",
    "/api/explain/thermal_lag",
    "/api/openapi.json",
    "/api/session",
)


@pytest.mark.parametrize("path", PRIVATE)
def test_nothing_is_said_to_nobody(served: Served, path: str) -> None:
    with served.client(None) as client:
        answer = client.get(path)
    assert answer.status_code == 401
    assert list(answer.json()) == ["error"]
    assert answer.headers["www-authenticate"] == "Bearer"
    assert answer.headers["cache-control"] == "no-store"


@pytest.mark.parametrize(
    "shown",
    [
        "Bearer",
        "Bearer x",
        "Basic {token}",
        "{token}",
        "Bearer {token}x",
        "Bearer {half}",
        "bearer\t{token}",
        "Bearer {token} {token}",
        "Token {token}",
    ],
)
def test_what_is_not_a_token_is_nobody(served: Served, shown: str) -> None:
    header = shown.format(token=served.token, half=served.token[:20])
    with served.client(None, Authorization=header) as client:
        assert client.get("/api/campaigns").status_code == 401
        assert client.post("/api/session").status_code == 401


def test_the_name_of_the_scheme_may_be_written_in_small_letters(served: Served) -> None:
    with served.client(None, Authorization=f"bearer {served.token}") as client:
        assert client.get("/api/campaigns").status_code == 200


@pytest.mark.parametrize("where", ["?token={token}", "?access_token={token}", "?authorization=Bearer%20{token}"])
def test_a_token_in_the_address_opens_nothing(served: Served, where: str) -> None:
    with served.client(None) as client:
        assert client.get("/api/campaigns" + where.format(token=served.token)).status_code == 401


def test_a_token_that_is_wrong_is_not_mended_by_a_session(served: Served) -> None:
    with served.browser() as (client, _):
        assert client.get("/api/campaigns").status_code == 200
        assert client.get("/api/campaigns", headers={"Authorization": "Bearer x"}).status_code == 401


def test_a_session_says_what_it_may_do_and_its_cookie_is_for_no_script_and_no_other_site(served: Served) -> None:
    with served.client(None) as client:
        begun = client.post("/api/session", headers={"Authorization": f"Bearer {served.view_token}"})
        assert begun.json()["role"] == "viewer"
        cookie = begun.headers["set-cookie"]
        assert cookie.startswith(f"benchctl_{served.port}=")
        assert {part.strip().lower() for part in cookie.split(";")[1:]} == {"httponly", "path=/", "samesite=strict"}
        assert served.view_token not in cookie
        assert client.get("/api/session").json() == begun.json()


def test_every_log_in_is_a_session_of_its_own(served: Served) -> None:
    with served.browser() as (one, one_csrf), served.browser() as (other, other_csrf):
        assert one_csrf != other_csrf
        assert one.delete("/api/session", headers={"X-CSRF": other_csrf}).status_code == 403
        assert one.delete("/api/session", headers={"X-CSRF": one_csrf}).status_code == 204
        assert one.get("/api/session").status_code == 401
        assert other.get("/api/session").status_code == 200


@pytest.mark.parametrize("word", ["", "x", None])
def test_a_session_changes_nothing_without_its_word(served: Served, word: str | None) -> None:
    headers = {} if word is None else {"X-CSRF": word}
    with served.browser() as (client, _):
        refused = client.delete("/api/session", headers=headers)
        assert (refused.status_code, list(refused.json())) == (403, ["error"])
        assert client.get("/api/session").status_code == 200


def test_a_session_that_is_over_is_over_for_a_cookie_that_was_copied(served: Served) -> None:
    name = f"benchctl_{served.port}"
    with served.browser() as (client, csrf), served.client(None) as thief:
        secret = client.cookies[name]
        client.delete("/api/session", headers={"X-CSRF": csrf})
        assert thief.get("/api/campaigns", headers={"Cookie": f"{name}={secret}"}).status_code == 401


@pytest.mark.parametrize(
    "cookie", ["{name}=", "{name}=x", "{name}={token}", "other={token}", "{name}=a; {name}=b", ";;="]
)
def test_a_cookie_that_is_no_session_is_nobody(served: Served, cookie: str) -> None:
    shown = cookie.format(name=f"benchctl_{served.port}", token=served.token)
    with served.client(None, Cookie=shown) as client:
        assert client.get("/api/campaigns").status_code == 401
