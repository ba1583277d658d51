"""What is answered, as JSON: made in the thread that read it, so that large answers do not hold up the others."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from typing import Any

from starlette.responses import Response

from benchctl.dashboard.web.readers import Readers


def json_text(value: Any) -> str:
    """A value as JSON, which has no NaN and no infinity: they become null."""
    try:
        return _dumped(value)
    except ValueError:
        return _dumped(_plain(value))


async def answer(readers: Readers, read: Callable[[], Any]) -> Response:
    """Whatever `read` returns, as an answer; it runs in one of the `readers`."""
    body = await readers.run(lambda: json_text(read()).encode())
    return Response(body, media_type="application/json")


def _dumped(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
