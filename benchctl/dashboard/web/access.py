"""Authentication: by a token in the header, or by a session's cookie and, for changes, its CSRF token."""

from __future__ import annotations

import hmac
from dataclasses import dataclass
from typing import Annotated, Any, get_args

from fastapi import APIRouter, Depends, Header
from starlette.requests import HTTPConnection, Request
from starlette.responses import Response

from benchctl.dashboard.web.answers import RefusalError
from benchctl.dashboard.web.models import Error, SessionSaid
from benchctl.dashboard.web.sessions import Role, Session
from benchctl.dashboard.web.site import Site, SiteOf

_HARMLESS = frozenset({"GET", "HEAD"})


@dataclass(frozen=True, slots=True)
class Caller:
    """An authenticated client; `secret` is that of the session, None for a program that sends a token."""

    role: Role
    secret: str | None = None


_TOKENS: dict[Role, str] = {"operator": "token or release_token", "releaser": "release_token"}


def require(caller: Caller, role: Role, what: str) -> None:
    """Raise `RefusalError` 403 if a client has less than a role; `what` takes it, such as "signs an acceptance"."""
    roles = get_args(Role)
    if roles.index(caller.role) < roles.index(role):
        may = "only looks" if caller.role == "viewer" else "does not sign"
        raise RefusalError(403, f"this token {may}; who {what} logs in with {_TOKENS[role]} of benchctl serve")


async def caller_of(connection: HTTPConnection, site: SiteOf) -> Caller:
    """Authenticate a request or a websocket; a token in the header has priority over the cookie.

    Raises `RefusalError`: 401 for an unknown client, 403 for a session's changing request without its CSRF token.
    """
    if "authorization" in connection.headers:
        return Caller(_role_of_header(connection.headers["authorization"], site))
    secret = connection.cookies.get(site.cookie, "")
    session = site.sessions.find(secret)
    if session is None:
        raise _unknown("log in: send the token that benchctl serve printed as `Authorization: Bearer TOKEN`")
    if connection.scope["type"] == "http" and connection.scope["method"] not in _HARMLESS:
        word = connection.headers.get("x-csrf", "")
        if not hmac.compare_digest(word.encode(), session.csrf.encode()):
            raise RefusalError(403, "X-CSRF is not this session's; GET /api/session returns it")
    return Caller(session.role, secret)


async def token_role_of(connection: HTTPConnection, site: SiteOf) -> Role:
    """Return the role of a token in the header; `RefusalError` 401 without a valid one."""
    return _role_of_header(connection.headers.get("authorization", ""), site)


def _role_of_header(authorization: str, site: SiteOf) -> Role:
    scheme, _, token = authorization.partition(" ")
    role = site.tokens.role_of(token.strip()) if scheme.lower() == "bearer" else None
    if role is None:
        raise _unknown("this is not the server's token; it has a new one each time it starts")
    return role


def _unknown(message: str) -> RefusalError:
    return RefusalError(401, message, {"www-authenticate": "Bearer"})


CallerOf = Annotated[Caller, Depends(caller_of)]
TokenRoleOf = Annotated[Role, Depends(token_role_of)]


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
    return _said(session, site)


@router.get("", openapi_extra=ONLY_SESSION)
async def session_now(site: SiteOf, request: Request) -> SessionSaid:
    """Return the session of the cookie."""
    session = site.sessions.find(request.cookies.get(site.cookie, ""))
    if session is None:
        raise _no_session()
    return _said(session, site)


@router.delete("", status_code=204, openapi_extra=ONLY_SESSION, responses={403: {"model": Error}})
async def log_out(site: SiteOf, caller: CallerOf, response: Response, x_csrf: CsrfHeader = None) -> None:
    """End the session of the cookie."""
    if caller.secret is None:
        raise _no_session()
    site.sessions.end(caller.secret)
    response.delete_cookie(site.cookie, path="/", httponly=True, samesite="strict")


def _said(session: Session, site: Site) -> SessionSaid:
    role = session.role
    return SessionSaid(role=role, csrf=session.csrf, may_start=site.may_start(role), may_sign=site.may_sign(role))


def _no_session() -> RefusalError:
    return RefusalError(401, "there is no session, or it is over; log in", {"www-authenticate": "Bearer"})
