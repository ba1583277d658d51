"""Who has logged in: the server's two tokens, and the sessions of browsers that have shown one.

A browser shows its cookie in place of the token, and a second secret (CSRF) that other sites cannot read.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

Role = Literal["operator", "viewer"]


def new_secret() -> str:
    """A text that nobody guesses: 256 bits, in letters that a URL and a header take."""
    return secrets.token_urlsafe(32)


@dataclass(frozen=True, slots=True)
class Tokens:
    """The secrets, made anew for every server and never written anywhere; with `read_only` neither may stop a run."""

    read_only: bool = False
    token: str = field(default_factory=new_secret, repr=False)
    view_token: str = field(default_factory=new_secret, repr=False)

    def role_of(self, shown: str) -> Role | None:
        """What somebody who shows this may do; None: nothing. Takes as long whatever is shown."""
        given = shown.encode()
        is_token = hmac.compare_digest(given, self.token.encode())
        is_view_token = hmac.compare_digest(given, self.view_token.encode())
        if is_token:
            return "viewer" if self.read_only else "operator"
        return "viewer" if is_view_token else None


MOST_SESSIONS = 256
IDLE_S = 12 * 3600.0


@dataclass(slots=True)
class Session:
    """One log-in. `csrf` goes with every request that changes something: other sites cannot read it."""

    role: Role
    csrf: str = field(default_factory=new_secret, repr=False)
    seen_s: float = 0.0


class Sessions:
    """The living sessions; one that was idle for twelve hours, or is the longest idle of too many, is over."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._sessions: dict[bytes, Session] = {}

    def begin(self, role: Role) -> tuple[str, Session]:
        """A new session, and the secret by which it is found."""
        if len(self._sessions) >= MOST_SESSIONS:
            del self._sessions[min(self._sessions, key=lambda key: self._sessions[key].seen_s)]
        secret, session = new_secret(), Session(role, seen_s=self._clock())
        self._sessions[_key(secret)] = session
        return secret, session

    def find(self, secret: str) -> Session | None:
        """The session of that secret, if it lives."""
        session = self._sessions.get(_key(secret))
        if session is None:
            return None
        if self._clock() - session.seen_s > IDLE_S:
            self.end(secret)
            return None
        session.seen_s = self._clock()
        return session

    def end(self, secret: str) -> None:
        """End a session; nothing where there is none."""
        self._sessions.pop(_key(secret), None)


def _key(secret: str) -> bytes:
    """What a session is kept by: how long a look-up takes must say nothing about the secret."""
    return hashlib.sha256(secret.encode()).digest()
