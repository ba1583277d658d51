"""The server's three tokens, and the sessions of browsers that have logged in with one.

A browser sends its cookie instead of the token, and a second secret (CSRF) that other sites cannot read.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

Role = Literal["viewer", "operator", "releaser"]
"""Who looks, who also starts, answers and stops runs, and who also signs acceptances: each may what the one before may.
"""


def new_secret() -> str:
    """Return an unguessable text: 256 bits, in characters that are valid in URLs and headers."""
    return secrets.token_urlsafe(32)


@dataclass(frozen=True, slots=True)
class Tokens:
    """The secrets, new for every server and never stored; with `read_only` all may view only."""

    read_only: bool = False
    token: str = field(default_factory=new_secret, repr=False)
    view_token: str = field(default_factory=new_secret, repr=False)
    release_token: str = field(default_factory=new_secret, repr=False)

    def role_of(self, shown: str) -> Role | None:
        """Return the role of a token; None for an unknown one. Runs in constant time."""
        tokens: dict[Role, str] = {
            "viewer": self.view_token,
            "operator": self.token,
            "releaser": self.release_token,
        }
        roles = [role for role, token in tokens.items() if hmac.compare_digest(shown.encode(), token.encode())]
        if not roles:
            return None
        return "viewer" if self.read_only else roles[0]


MOST_SESSIONS = 256
IDLE_S = 12 * 3600.0


@dataclass(slots=True)
class Session:
    """One log-in. `csrf` is sent with every request for a change: other sites cannot read it."""

    role: Role
    csrf: str = field(default_factory=new_secret, repr=False)
    seen_s: float = 0.0


class Sessions:
    """The active sessions; they end after twelve idle hours, or if they are idle longest when there are too many."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._sessions: dict[bytes, Session] = {}

    def begin(self, role: Role) -> tuple[str, Session]:
        """Return a new session, and the secret that identifies it."""
        if len(self._sessions) >= MOST_SESSIONS:
            del self._sessions[min(self._sessions, key=lambda key: self._sessions[key].seen_s)]
        secret, session = new_secret(), Session(role, seen_s=self._clock())
        self._sessions[_key(secret)] = session
        return secret, session

    def find(self, secret: str) -> Session | None:
        """Return the session of that secret, if it is active."""
        session = self._sessions.get(_key(secret))
        if session is None:
            return None
        if self._clock() - session.seen_s > IDLE_S:
            self.end(secret)
            return None
        session.seen_s = self._clock()
        return session

    def end(self, secret: str) -> None:
        """End a session, if it exists."""
        self._sessions.pop(_key(secret), None)


def _key(secret: str) -> bytes:
    """Return the key of a session: a hash, so that the time of a look-up reveals nothing about the secret."""
    return hashlib.sha256(secret.encode()).digest()
