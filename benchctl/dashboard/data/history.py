"""The history of the units in a folder, for the page: the data of `benchctl history --json`."""

from __future__ import annotations

import hashlib
import os
import threading
from pathlib import Path
from typing import Any

from benchctl.history.history import history_of
from benchctl.reports.history_report import values

_one_at_a_time = threading.Lock()


def history_json(root: Path, cache: Path) -> dict[str, Any]:
    """Return units, their campaigns, figures and flags, and uncounted files; the index is stored in `cache`.

    Nothing is written below `root`, and the path of the index is not revealed (`index` is None). Raises `UsageError` if
    there is no campaign below `root`.
    """
    name = hashlib.sha256(os.fsencode(root.resolve())).hexdigest()[:32]
    with _one_at_a_time:
        kept_at = cache / f"history-{name}.sqlite"
        found = history_of(root, root.name, lambda message: None, kept_at=kept_at, follow_links=False)
    return {**values(found, found.units), "index": None}
