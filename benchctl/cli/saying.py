"""A line on stdout or stderr, whoever reads it, or nobody."""

from __future__ import annotations

import os
import sys
from typing import TextIO


def tell(text: str, *, err: bool = False) -> None:
    """A line on stdout or stderr; where nobody reads it any more, the work goes on all the same."""
    stream = sys.stderr if err else sys.stdout
    try:
        stream.write(f"{text}\n")
        stream.flush()
    except OSError:
        let_go(stream)


def let_go(stream: TextIO) -> None:
    """Send what is still said on a stream nowhere: its window was closed, or the reader of its pipe has gone."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
