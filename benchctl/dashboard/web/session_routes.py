"""Logging in and out."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Header
from starlette.requests import Request
from starlette.responses import Response

from benchctl.dashboard.web.access import CallerOf, TokenRoleOf
from benchctl.dashboard.web.models import Error, SessionSaid
from benchctl.dashboard.web.refusal import RefusalError
from benchctl.dashboard.web.site import SiteOf

ONLY_TOKEN: dict[str, Any] = {"security": [{"token": []}]}
ONLY_SESSION: dict[str, Any] = {"security": [{"session": []}]}
CsrfHeader = Annotated[
    str | None, Header(alias="X-CSRF", description="The session's word; not needed with a token in the header.")
]

router = APIRouter(prefix="/api/session", tags=["session"], responses={401: {"model": Error}})


@router.post("", openapi_extra=ONLY_TOKEN)
async def log_in(site: SiteOf, role: TokenRoleOf, response: Response) -> SessionSaid:
    """Begin a session by a token; its cookie is set."""
    secret, session = site.sessions.begin(role)
    response.set_cookie(site.cookie, secret, path="/", httponly=True, samesite="strict")
    return SessionSaid(role=session.role, csrf=session.csrf)


@router.get("", openapi_extra=ONLY_SESSION)
async def session_now(site: SiteOf, request: Request) -> SessionSaid:
    """The session of the cookie."""
    session = site.sessions.find(request.cookies.get(site.cookie, ""))
    if session is None:
        raise _no_session()
    return SessionSaid(role=session.role, csrf=session.csrf)


@router.delete("", status_code=204, openapi_extra=ONLY_SESSION, responses={403: {"model": Error}})
async def log_out(site: SiteOf, caller: CallerOf, response: Response, x_csrf: CsrfHeader = None) -> None:
    """End the session of the cookie."""
    if caller.secret is None:
        raise _no_session()
    site.sessions.end(caller.secret)
    response.delete_cookie(site.cookie, path="/", httponly=True, samesite="strict")


def _no_session() -> RefusalError:
    return RefusalError(401, "there is no session, or it is over; log in", {"www-authenticate": "Bearer"})
