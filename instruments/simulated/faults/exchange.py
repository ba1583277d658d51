"""One request on a link and what comes of it: the pieces that a server sends, when, and what becomes of the link."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from benchctl_instruments.simulated.faults.wires import Wire


@dataclass(frozen=True, slots=True, kw_only=True)
class Exchange:
    """A request as it has come in.

    `carry_out` has the instrument obey it and gives its true answer, b"" where it has none; to be called at most once.
    `happen` does to the instrument what a hand or the world does: "open_interlock", "following_error", "restart".
    """

    request: bytes
    wire: Wire
    carry_out: Callable[[], bytes]
    happen: Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """Bytes that leave `after_s` of wall time after what was before them."""

    data: bytes
    after_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What leaves for one request.

    `held` waits for the next request on the same connection and leaves `behind_s` of wall time before the answer to
    that. With `cut` the
    connection ends after the pieces. For `deaf_s` of wall time from now on the instrument hears nothing on any
    connection; with `gone` it does not listen either, and every connection ends.
    """

    pieces: tuple[Piece, ...] = ()
    held: bytes = b""
    behind_s: float = 0.0
    cut: bool = False
    deaf_s: float = 0.0
    gone: bool = False


def at_once(data: bytes) -> Answer:
    """The whole answer without delay."""
    return Answer(pieces=(Piece(data=data),))
