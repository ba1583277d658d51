"""The page's own files, all of them in memory: a request names an entry of a table, never a file."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

import benchctl.dashboard
from benchctl.dashboard.web.refusal import RefusalError

_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
    "": "text/plain; charset=utf-8",
}
"""What the page may consist of; LICENSE has no ending."""
_INDEX = "index.html"


@dataclass(frozen=True, slots=True)
class Page:
    """One file."""

    content: bytes
    type: str
    tag: str


def load_pages() -> dict[str, Page]:
    """All files of the page, by their path below its folder, with `/`."""
    root = Path(benchctl.dashboard.__file__).parent / "page"
    files = [path for path in root.rglob("*") if path.suffix in _TYPES and path.is_file()]
    return {path.relative_to(root).as_posix(): _page(path) for path in files}


def page_routes(pages: Mapping[str, Page]) -> list[Route]:
    """`index.html` at `/`, the others below `/page/`."""

    async def index(request: Request) -> Response:
        return _answer(request, pages.get(_INDEX))

    async def other(request: Request) -> Response:
        name = request.path_params["name"]
        return _answer(request, pages.get(name) if name != _INDEX else None)

    return [Route("/", index), Route("/page/{name:path}", other)]


def _answer(request: Request, page: Page | None) -> Response:
    if page is None:
        raise RefusalError(404, "there is no such page; begin at /")
    headers = {"ETag": page.tag, "Cache-Control": "no-cache"}
    if request.headers.get("if-none-match") == page.tag:
        return Response(status_code=304, headers=headers)
    return Response(page.content, media_type=page.type, headers=headers)


def _page(path: Path) -> Page:
    content = path.read_bytes()
    return Page(content, _TYPES[path.suffix], f'"{hashlib.sha256(content).hexdigest()[:32]}"')
