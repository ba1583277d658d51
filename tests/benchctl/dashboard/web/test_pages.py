from pathlib import Path

import pytest

import benchctl.dashboard
from benchctl.app.handbook import topics
from benchctl.dashboard.web.app import load_pages
from tests.benchctl.dashboard.web.serving import Served, everything

ROOT = Path(benchctl.dashboard.__file__).parent / "page"


def test_every_file_of_the_page_is_served_as_it_is_and_needs_no_token(served: Served) -> None:
    pages = load_pages()
    assert "index.html" in pages
    with served.client(None) as client:
        for name, page in pages.items():
            answer = client.get("/" if name == "index.html" else f"/page/{name}")
            assert (answer.status_code, answer.content) == (200, (ROOT / name).read_bytes()), name
            assert answer.headers["content-type"] == page.type
            assert answer.headers["x-content-type-options"] == "nosniff"
            assert answer.headers["content-security-policy"].startswith("default-src 'none'; script-src 'self';")


def test_a_page_that_the_browser_has_is_not_sent_again(served: Served) -> None:
    with served.client(None) as client:
        tag = client.get("/").headers["etag"]
        again = client.get("/", headers={"If-None-Match": tag})
        assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", tag)
        assert client.get("/", headers={"If-None-Match": '"other"'}).status_code == 200


@pytest.mark.parametrize(
    "name",
    [
        "",
        "nothing.js",
        "index.html",
        "../__init__.py",
        "..%2f__init__.py",
        "..%2f..%2fcli%2fserve.py",
        "%2e%2e/%2e%2e/bench.toml",
        "....//__init__.py",
        "..\\..\\bench.toml",
        "/etc/passwd",
        "%2fetc%2fpasswd",
        "vendor/../main.js",
        "main.js%00",
        "main.js/",
        "MAIN.JS",
        "file:///etc/passwd",
        "~root",
        "%c0%ae%c0%ae/bench.toml",
    ],
)
def test_no_other_name_leads_to_a_file(served: Served, name: str) -> None:
    with served.line() as line:  # a client of HTTP would tidy the name
        line.sendall(f"GET /page/{name} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n".encode())
        status, _, body = everything(line).partition(b"\r\n")
    assert status == b"HTTP/1.1 404 Not Found"
    assert body.endswith(b'{"error": "there is no such page; begin at /"}')


@pytest.mark.parametrize(
    ("path", "view"),
    [
        ("/help", "/#/help/"),
        ("/help/ci", "/#/help/ci"),
        ("/help/ci/gitlab", "/#/help/ci/gitlab"),
        ("/help/<b>%3Fq=1%23x", "/#/help/%3Cb%3E%3Fq%3D1%23x"),
    ],
)
def test_an_address_of_the_handbook_leads_to_its_view(served: Served, path: str, view: str) -> None:
    with served.client(None) as client:
        answer = client.get(path)
    assert (answer.status_code, answer.headers["location"]) == (303, view)


def test_the_handbook_is_told_to_those_who_have_a_token_only(served: Served) -> None:
    with served.client(None) as stranger, served.client(served.view_token) as viewer:
        assert stranger.get("/api/help").status_code == 401
        pages = viewer.get("/api/help").json()["pages"]
    assert [page["topic"] for page in pages] == [*topics(), "terms"]
    assert "thermal-lag" in [section["anchor"] for section in pages[-1]["sections"]]
