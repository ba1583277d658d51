"""The live page as one ASGI application: routes, errors in words, and the gate before all of it."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from fastapi.openapi.utils import get_openapi
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.types import ASGIApp

import benchctl
from benchctl.dashboard.web import campaign_routes, live_routes, other_routes, session_routes
from benchctl.dashboard.web.gate import Gate
from benchctl.dashboard.web.pages import load_pages, page_routes
from benchctl.dashboard.web.refusal import RefusalError, error_body
from benchctl.dashboard.web.site import Site
from benchctl_instruments.errors import UsageError

_SAYS = {404: "there is nothing at this address", 405: "this address does not take that method"}


def page_app(site: Site, names: frozenset[str]) -> ASGIApp:
    """The application for a site; `names` are those under which it may be asked for."""
    app = FastAPI(title="benchctl", version=benchctl.__version__, openapi_url=None, docs_url=None, redoc_url=None)
    app.state.site = site
    for routes in (session_routes, campaign_routes, live_routes, other_routes):
        app.include_router(routes.router)
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

A websocket at `/api/campaigns/{key}/live`, which OpenAPI cannot describe, says up to four times a second what a
campaign does; send `{"watch": {"channels": ["gyro_v"], "window_s": 600, "pixels": 800}}` to have channels with it."""


async def _refused(connection: HTTPConnection, error: Exception) -> Response:
    assert isinstance(error, RefusalError)  # noqa: S101 - for the type
    return _said(error.status, error.says, dict(error.headers))


async def _unrouted(connection: HTTPConnection, error: Exception) -> Response:
    assert isinstance(error, HTTPException)  # noqa: S101 - for the type
    says = _SAYS.get(error.status_code, str(error.detail))
    return _said(error.status_code, says, dict(error.headers or {}))


async def _not_understood(connection: HTTPConnection, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)  # noqa: S101 - for the type
    first = error.errors()[0]
    where = ".".join(str(part) for part in first["loc"])
    return _said(422, f"{where}: {first['msg']}")


async def _unusable(connection: HTTPConnection, error: Exception) -> Response:
    return _said(422, " ".join(str(error).split()))


async def _unreadable(connection: HTTPConnection, error: Exception) -> Response:
    assert isinstance(error, OSError)  # noqa: S101 - for the type
    return _said(422, f"cannot be read: {error.strerror or error}")


async def _failed(connection: HTTPConnection, error: Exception) -> Response:
    return _said(500, "a fault of the server; its terminal says more")


def _said(status: int, says: str, headers: dict[str, str] | None = None) -> Response:
    return Response(error_body(says), status, headers, media_type="application/json")
