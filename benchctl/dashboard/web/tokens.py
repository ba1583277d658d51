"""The two secrets of one server: one may stop a run, the other only looks."""

from __future__ import annotations

import hmac
import secrets
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
