"""The live page as one ASGI application: routes, error handlers, and the gate in front of them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, FastAPI
from fastapi import Path as PathParameter
from fastapi.exceptions import RequestValidationError
from fastapi.openapi.utils import get_openapi
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

import benchctl
import benchctl.dashboard
from benchctl.app.handbook import topics
from benchctl.dashboard.data.handbook import handbook_json
from benchctl.dashboard.web import access, campaign_routes, live_routes, start_routes
from benchctl.dashboard.web.access import CallerOf
from benchctl.dashboard.web.answers import RefusalError, answer, error_body
from benchctl.dashboard.web.gate import Gate
from benchctl.dashboard.web.models import Error, Explanation, Handbook, History
from benchctl.dashboard.web.site import Site, SiteOf
from benchctl_instruments.errors import UsageError

router = APIRouter(prefix="/api", responses={401: {"model": Error}, 422: {"model": Error}, 503: {"model": Error}})

Term = Annotated[str, PathParameter(min_length=1, max_length=100)]


@router.get("/history", response_model=History, responses={404: {"model": Error}}, tags=["units"])
async def history(site: SiteOf, caller: CallerOf) -> Response:
    """Return the results of calibrations and acceptances of each unit over time."""
    return await answer(site.heavy, lambda: _history(site))


@router.get("/explain/{term}", response_model=Explanation, responses={404: {"model": Error}}, tags=["words"])
async def explain(term: Term, site: SiteOf, caller: CallerOf) -> Response:
    """Explain an effect, a metric or a term."""
    return await answer(site.heavy, lambda: _explained(site, term))


@router.get("/help", response_model=Handbook, tags=["words"])
async def handbook(site: SiteOf, caller: CallerOf) -> Response:
    """Return the handbook, and the glossary as its last page."""
    return await answer(site.heavy, lambda: handbook_json({**topics(), "terms": site.glossary()}))


@router.get("/openapi.json", include_in_schema=False)
async def openapi(request: Request, caller: CallerOf) -> Response:
    """Return the OpenAPI description of the interface."""
    return JSONResponse(request.app.openapi())


def _history(site: Site) -> object:
    from benchctl.dashboard.data.history import history_json  # its fits take seconds to import

    try:
        return history_json(site.root, site.cache)
    except UsageError as err:  # no file in the folder states a result of a unit
        raise RefusalError(404, str(err)) from err


def _explained(site: Site, term: str) -> object:
    try:
        return site.explain(term)
    except UsageError as err:
        raise RefusalError(404, str(err)) from err


_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
    "": "text/plain; charset=utf-8",
}
"""Suffixes of the page's files with their media types; LICENSE has no suffix."""
_INDEX = "index.html"


@dataclass(frozen=True, slots=True)
class Page:
    """A file of the page."""

    content: bytes
    type: str
    tag: str


def load_pages() -> dict[str, Page]:
    """Load all files of the page, by their path relative to its folder, with `/`."""
    root = Path(benchctl.dashboard.__file__).parent / "page"
    files = [path for path in root.rglob("*") if path.suffix in _TYPES and path.is_file()]
    return {path.relative_to(root).as_posix(): _page(path) for path in files}


def page_routes(pages: Mapping[str, Page]) -> list[Route]:
    """Return the routes: `index.html` at `/`, the others below `/page/`; `/help/…` leads to a view of the page."""

    async def index(request: Request) -> Response:
        return _answer(request, pages.get(_INDEX))

    async def other(request: Request) -> Response:
        name = request.path_params["name"]
        return _answer(request, pages.get(name) if name != _INDEX else None)

    async def help_view(request: Request) -> Response:
        return RedirectResponse(f"/#/help/{quote(request.path_params.get('place', ''))}", 303)

    helps = [Route("/help", help_view), Route("/help/{place:path}", help_view)]
    return [Route("/", index), Route("/page/{name:path}", other), *helps]


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


_SAYS = {404: "there is nothing at this address", 405: "this address does not take that method"}


def page_app(site: Site, names: frozenset[str]) -> ASGIApp:
    """Return the application for a site; `names` are the accepted host names."""
    app = FastAPI(title="benchctl", version=benchctl.__version__, openapi_url=None, docs_url=None, redoc_url=None)
    app.state.site = site
    for part in (access.router, campaign_routes.router, start_routes.router, live_routes.router, router):
        app.include_router(part)
    app.router.routes += page_routes(load_pages())
    app.openapi = lambda: _described(app, site)  # type: ignore[method-assign]  # as FastAPI documents
    app.add_exception_handler(RefusalError, _refused)
    app.add_exception_handler(HTTPException, _unrouted)
    app.add_exception_handler(RequestValidationError, _not_understood)
    app.add_exception_handler(UsageError, _unusable)
    app.add_exception_handler(OSError, _unreadable)
    app.add_exception_handler(Exception, _failed)
    return Gate(app, names)


def _described(app: FastAPI, site: Site) -> dict[str, Any]:
    if app.openapi_schema is None:
        schema = get_openapi(title=app.title, version=app.version, description=_ABOUT, routes=app.routes)
        schema["components"]["securitySchemes"] = {
            "token": {"type": "http", "scheme": "bearer", "description": "A token that benchctl serve printed."},
            "session": {"type": "apiKey", "in": "cookie", "name": site.cookie, "description": "See POST /api/session."},
        }
        schema["security"] = [{"token": []}, {"session": []}]
        app.openapi_schema = schema
    return app.openapi_schema


_ABOUT = """Campaigns of benchctl: those that run and those that are over.

A websocket at `/api/campaigns/{key}/live`, which OpenAPI cannot describe, sends up to four times a second what a
campaign does; send `{"watch": {"channels": ["gyro_v"], "window_s": 600, "pixels": 800}}` to have channels with it."""


async def _refused(connection: HTTPConnection, error: Exception) -> Response:
    assert isinstance(error, RefusalError)  # noqa: S101 - for the type
    return _error(error.status, error.message, dict(error.headers))


async def _unrouted(connection: HTTPConnection, error: Exception) -> Response:
    assert isinstance(error, HTTPException)  # noqa: S101 - for the type
    message = _SAYS.get(error.status_code, str(error.detail))
    return _error(error.status_code, message, dict(error.headers or {}))


async def _not_understood(connection: HTTPConnection, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)  # noqa: S101 - for the type
    first = error.errors()[0]
    where = ".".join(str(part) for part in first["loc"])
    return _error(422, f"{where}: {first['msg']}")


async def _unusable(connection: HTTPConnection, error: Exception) -> Response:
    return _error(422, " ".join(str(error).split()))


async def _unreadable(connection: HTTPConnection, error: Exception) -> Response:
    assert isinstance(error, OSError)  # noqa: S101 - for the type
    return _error(422, f"cannot be read: {error.strerror or error}")


async def _failed(connection: HTTPConnection, error: Exception) -> Response:
    return _error(500, "a fault of the server; its terminal shows more")


def _error(status: int, message: str, headers: dict[str, str] | None = None) -> Response:
    return Response(error_body(message), status, headers, media_type="application/json")
