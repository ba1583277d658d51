"""What every request passes first, over real sockets."""

import pytest

from benchctl.dashboard.web.gate import MOST_BODY_BYTES
from tests.benchctl.dashboard.web.serving import Served, everything

EVERYWHERE = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}


@pytest.mark.parametrize(
    "path", ["/", "/page/main.js", "/nothing", "/api/campaigns", "/api/nothing", "/api/openapi.json"]
)
def test_every_answer_carries_the_headers_that_keep_a_browser_safe(served: Served, path: str) -> None:
    with served.client() as client:
        headers = client.get(path).headers
    assert {name: headers.get(name) for name in EVERYWHERE} == EVERYWHERE
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    assert "unsafe" not in headers["content-security-policy"]
    assert "server" not in headers
    assert "access-control-allow-origin" not in headers
    assert (headers.get("cache-control") == "no-store") == path.startswith("/api")


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "192.168.0.1:{port}", "127.0.0.1.nip.io:{port}"]
)
@pytest.mark.parametrize("path", ["/", "/api/campaigns"])
def test_a_name_that_was_pointed_here_is_refused_whatever_token_it_shows(served: Served, host: str, path: str) -> None:
    with served.client(Host=host.format(port=served.port)) as client:
        answer = client.get(path)
    assert (answer.status_code, list(answer.json())) == (421, ["error"])


def test_through_a_tunnel_the_port_is_another_one(served: Served) -> None:
    with served.client(Host="localhost:9000", Origin="http://localhost:9000") as client:
        assert client.get("/api/campaigns").status_code == 200
        assert client.post("/api/session").status_code == 200


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", "https://127.0.0.1:{port}"])
def test_another_sites_page_cannot_change_anything(served: Served, origin: str) -> None:
    headers = {"Origin": origin.format(port=served.port)}
    with served.browser() as (client, csrf):
        headers["X-CSRF"] = csrf
        assert client.delete("/api/session", headers=headers).status_code == 403
        assert (
            client.post("/api/session", headers={**headers, "Authorization": f"Bearer {served.token}"}).status_code
            == 403
        )
        assert client.get("/api/session").status_code == 200


def test_another_sites_page_is_not_told_that_it_may_ask(served: Served) -> None:
    asks = {"Origin": "http://evil.example", "Access-Control-Request-Method": "POST"}
    with served.client(None, **asks) as client:
        answer = client.options("/api/session")
    assert answer.status_code == 403
    assert not any(name.startswith("access-control") for name in answer.headers)


def test_a_body_that_is_too_large_is_refused_before_it_is_sent(served: Served) -> None:
    with served.line() as line:
        line.sendall(head(served, "POST /api/session", f"Content-Length: {10 * MOST_BODY_BYTES}"))
        assert b" 413 " in line.recv(4096)


def test_a_body_that_grows_too_large_on_the_way_is_refused(served: Served) -> None:
    with served.client() as client:
        answer = client.post("/api/session", content=(b"x" * 4096 for _ in range(1000)))
    assert (answer.status_code, answer.json()["error"]) == (413, f"the body is larger than {MOST_BODY_BYTES} bytes")


def test_a_body_that_just_fits_is_taken(served: Served) -> None:
    with served.client() as client:
        assert client.post("/api/session", content=b"x" * MOST_BODY_BYTES).status_code == 200


@pytest.mark.parametrize("length", ["-1", "1e3", "x", "99999999999999999999999"])
def test_a_length_that_is_none_is_refused(served: Served, length: str) -> None:
    with served.line() as line:
        line.sendall(head(served, "POST /api/session", f"Content-Length: {length}"))
        assert line.recv(4096).split(b" ")[1] in (b"400", b"413")


def test_a_header_that_is_too_large_is_refused(served: Served) -> None:
    with served.line() as line:
        line.sendall(head(served, "GET /api/campaigns", f"X: {'x' * 50_000}"))
        assert line.recv(4096).split(b" ")[1] in (b"400", b"431")


def test_headers_that_are_too_many_are_refused(served: Served) -> None:
    with served.line() as line:
        line.sendall(head(served, "GET /api/campaigns", *(f"X{number}: x" for number in range(4000))))
        assert line.recv(4096).split(b" ")[1] in (b"400", b"431")


@pytest.mark.slow
def test_a_body_that_does_not_come_is_not_waited_for(served: Served) -> None:
    with served.line(timeout_s=30.0) as line:
        line.sendall(head(served, "POST /api/session", "Content-Length: 10") + b"only")
        assert b" 408 " in everything(line)


def head(served: Served, request: str, *headers: str) -> bytes:
    """A request's head, with the token."""
    lines = (f"{request} HTTP/1.1", f"Host: 127.0.0.1:{served.port}", f"Authorization: Bearer {served.token}", *headers)
    return ("\r\n".join(lines) + "\r\n\r\n").encode()
