"""The results on a campaign, written by the CLI next to it: calibration, diagnosis, acceptance, and their reports.

A document that names its recordings by their digests is used only if this campaign is one of them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from benchctl.dashboard.data.contents import contents_of
from benchctl.documents import read_json
from benchctl.limits import read_whole, require_file
from benchctl.recordings.reader import is_open_recording
from benchctl.reports.acceptance.signed import check_signed
from benchctl.reports.results import results_folder
from benchctl_instruments.errors import UsageError

Kind = Literal["calibration", "diagnosis", "acceptance"]
KINDS: tuple[Kind, ...] = get_args(Kind)

MOST_REPORT_BYTES = 32 << 20
"""Maximum size of a self-contained page: ours have 1 to 3 MB."""

_STATED = re.compile(rb"<dt>Recording, SHA-256</dt>\s*<dd>([0-9a-f, ]*)</dd>")
"""The place in our reports with the digests of the recordings."""


@dataclass(frozen=True, slots=True)
class _Form:
    """The files of a kind of document, its schema, and the keys that are sent to the page."""

    summary: str
    report: str
    schema: str
    keys: tuple[str, ...]


_FORMS: Mapping[Kind, _Form] = {
    "calibration": _Form(
        "coefficients.json",
        "report.html",
        "benchctl-coefficients/1",
        (
            *("unit", "output_unit", "convention", "argument", "K0_v_per_dps", "U0_v", "T0_c", "S_rad_per_dps"),
            *("stages", "valid", "uncertainty", "error_percent", "rms_percent", "joint", "free_motion"),
            *("misfit_percent_of_full_scale", "warnings", "notes"),
        ),
    ),
    "diagnosis": _Form(
        "diagnosis.json",
        "diagnosis.html",
        "benchctl-diagnosis/2",
        (
            *("verdict", "says", "baseline", "findings", "unexplained", "fit", "next_experiment", "not_found"),
            *("notes", "map"),
        ),
    ),
    "acceptance": _Form(
        "acceptance.json",
        "acceptance.html",
        "benchctl-acceptance/1",
        ("verdict", "tally", "tests", "unit_under_test", "started_utc", "stage", "limits", "rule", "anomalies"),
    ),
}
_FOR_PROGRAMS = ("covariance", "text", "budget", "k_T", "k_omega", "standard", "shares", "U0_T")
"""Keys at any level that are not sent to the page; programs read them from the file."""


def document(path: Path, kind: Kind) -> dict[str, Any] | None:
    """Return the content of a document for the page; None if there is none, or if it is of another recording.

    Raises `UsageError` if it cannot be read, or if the campaign cannot.
    """
    form, place = _FORMS[kind], _place(path, kind)
    content = _summary(place, form)
    if content is None or not _is_of(_digests(content), _digest(path)):
        return None
    signed = {"signed": signature_of(path)} if kind == "acceptance" else {}
    return {key: _plain(content[key]) for key in form.keys if key in content} | signed


def signature_of(path: Path) -> dict[str, Any] | None:
    """Return by whom the acceptance of a campaign is signed, and what differs from what was signed; None if it is not.

    Raises `UsageError` if a file cannot be read, or if the campaign cannot.
    """
    signature, problems = check_signed(_place(path, "acceptance"), _digest(path) or None, None)
    if signature is None and not problems:
        return None
    return {"says": signature.says if signature else "", "problems": list(map(str, problems))}


def report_of(path: Path, kind: Kind) -> bytes | None:
    """Return the stored HTML report; None if there is none, or if it is of another recording.

    Raises `UsageError` if it cannot be read or is too large, or if the campaign cannot be read.
    """
    return _report(_place(path, kind), _FORMS[kind], _digest(path))


def is_there(path: Path, kind: Kind, digest: str) -> bool:
    """Return whether the campaign with that digest has a document of that kind, or its report."""
    form, place = _FORMS[kind], _place(path, kind)
    try:
        content = _summary(place, form)
        if content is not None and _is_of(_digests(content), digest):
            return True
        return _report(place, form, digest) is not None
    except UsageError:
        return False


def files_of(path: Path) -> list[Path]:
    """Return the paths of a campaign's documents and reports, existing or not."""
    return [_place(path, kind) / name for kind, form in _FORMS.items() for name in (form.summary, form.report)]


def _place(path: Path, kind: Kind) -> Path:
    """Return the folder in which the CLI stores a document by default."""
    if kind == "calibration":
        return path if path.is_dir() else path.parent
    return path.with_name(f"{path.name}.{kind}") if is_open_recording(path) else results_folder(path, kind)


def _digest(path: Path) -> str:
    return contents_of(path).digest


def _summary(place: Path, form: _Form) -> dict[str, Any] | None:
    file = place / form.summary
    if not file.exists():
        return None
    require_file(file)
    content = read_json(file, "document")
    if not isinstance(content, dict) or content.get("schema") != form.schema:
        raise UsageError(f"{file}: expected schema {form.schema!r}; write it again with benchctl")
    return content


def _report(place: Path, form: _Form, digest: str) -> bytes | None:
    """Return the report of the recording with that digest, which it contains itself or in its document."""
    file = place / form.report
    if not file.exists():
        return None
    require_file(file, "report ")
    content = read_whole(file, MOST_REPORT_BYTES, "report ")
    stated = _stated(content) or _digests(_summary(place, form) or {})
    return content if _is_of(stated, digest) else None


def _digests(content: Mapping[str, Any]) -> set[str]:
    """Return the digests of the source recordings of a document."""
    source = content.get("source")
    named = [one.get("digest", "") for one in source if isinstance(one, dict)] if isinstance(source, list) else []
    return _split(", ".join(map(str, [*named, content.get("recording_digest") or ""])))


def _stated(page: bytes) -> set[str]:
    """Return the digests of the source recordings of a report; there may be several."""
    found = _STATED.search(page)
    return _split(found[1].decode()) if found else set()


def _split(text: str) -> set[str]:
    return set(filter(None, (one.strip() for one in text.split(","))))


def _is_of(stated: set[str], digest: str) -> bool:
    return not stated or digest in stated


def _plain(value: Any) -> Any:
    """Return the value without keys for programs only; numbers that are not finite become None."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items() if key not in _FOR_PROGRAMS}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
