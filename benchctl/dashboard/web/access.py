"""Who asks: by a token in the header, or by a session's cookie and, for what changes something, its CSRF word."""

from __future__ import annotations

import hmac
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends
from starlette.requests import HTTPConnection

from benchctl.dashboard.web.refusal import RefusalError
from benchctl.dashboard.web.site import SiteOf
from benchctl.dashboard.web.tokens import Role

_HARMLESS = frozenset({"GET", "HEAD"})


@dataclass(frozen=True, slots=True)
class Caller:
    """Somebody who may ask; `secret` is that of the session, None for a program that shows a token."""

    role: Role
    secret: str | None = None


async def caller_of(connection: HTTPConnection, site: SiteOf) -> Caller:
    """Who sends a request or opens a websocket; a token that is shown decides, whatever the cookie says.

    Raises `RefusalError`: 401 for nobody, 403 for a session's request without its CSRF word.
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
            raise RefusalError(403, "X-CSRF is not this session's; GET /api/session says it")
    return Caller(session.role, secret)


async def token_role_of(connection: HTTPConnection, site: SiteOf) -> Role:
    """What somebody may do who shows a token in the header; `RefusalError` 401 for everybody else."""
    return _role_of_header(connection.headers.get("authorization", ""), site)


def _role_of_header(authorization: str, site: SiteOf) -> Role:
    scheme, _, token = authorization.partition(" ")
    role = site.tokens.role_of(token.strip()) if scheme.lower() == "bearer" else None
    if role is None:
        raise _unknown("this is not the server's token; it has a new one each time it starts")
    return role


def _unknown(says: str) -> RefusalError:
    return RefusalError(401, says, {"www-authenticate": "Bearer"})


CallerOf = Annotated[Caller, Depends(caller_of)]
TokenRoleOf = Annotated[Role, Depends(token_role_of)]
