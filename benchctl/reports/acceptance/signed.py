"""The signature of an acceptance: a statement of what is signed, and beside it a signature by an OpenSSH key.

```
{"schema": "benchctl-signed-acceptance/1", "signer": "Anna Petrova (QA)", "public_key": "ssh-ed25519 AAAA…",
 "signed_utc": "2026-11-27T16:00:00Z", "unit": "SIM-0001", "verdict": "PASS",
 "recording": {"name": "first", "digest": "…"},
 "files": {"acceptance.html": {"sha256": "…", "bytes": 182114}, …}}
```

`recording` states the digest of the recording, which covers its samples. `files` are the files of the report; in a
campaign's folder all files of its manifest. `ssh-keygen -Y verify` checks the signature of the statement too.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, ValidationError

from benchctl.atomic import whole_file
from benchctl.limits import MOST_DESCRIPTION_BYTES, printable, read_whole
from benchctl.recordings.campaign_manifest import MANIFEST, content_of, entries_of, integrity, problems_of_folder
from benchctl.recordings.digests import Mismatch
from benchctl.recordings.reader import is_open_recording
from benchctl.recordings.schema import RECORDING
from benchctl.sshsig import SigningKey, accepted_name, signed_by
from benchctl_instruments.errors import UsageError, reason

if TYPE_CHECKING:  # `verify` starts three times as fast without them
    from benchctl.metrology.result import Acceptance
    from benchctl.reports.acceptance.set_up import RecordingFacts

PAGE, PDF, JUNIT, JSON = "acceptance.html", "acceptance.pdf", "acceptance.xml", "acceptance.json"
STATEMENT = "acceptance.signed.json"
SIGNATURE = f"{STATEMENT}.sig"
"""The file that states what is signed, and the signature of that file; named as `ssh-keygen -Y sign` names it."""

_REPORT = "acceptance."
"""The beginning of the names of all files that `accept` writes."""
_SCHEMA: Final = "benchctl-signed-acceptance/1"


class _Signed(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _File(_Signed):
    sha256: str
    bytes: int


class _Recording(_Signed):
    name: str
    digest: str


class _Statement(_Signed):
    schema_name: Literal["benchctl-signed-acceptance/1"] = Field(default=_SCHEMA, alias="schema")
    signer: str
    public_key: str
    signed_utc: AwareDatetime
    unit: str
    verdict: str
    recording: _Recording
    files: dict[str, _File]


def refuse_unsignable(folder: Path, facts: RecordingFacts) -> None:
    """Raise `UsageError` if a recording has no digest, or other files of the campaign's folder were changed."""
    if not facts.digest or is_open_recording(facts.path):
        raise UsageError(
            f"--sign: {facts.path}: has no digest that could be signed; close a campaign with benchctl recover, "
            "import an open recording with benchctl import"
        )
    if not (folder / MANIFEST).exists():
        return
    problem = next((one for one in problems_of_folder(folder) if not one.where.startswith(_REPORT)), None)
    if problem is not None:
        raise UsageError(
            f"--sign: {folder}: differs from its manifest, and so is not signed: {problem}; take the campaign from "
            "where it was copied"
        )


def write_signed(
    folder: Path, acceptance: Acceptance, facts: RecordingFacts, report: Iterable[Path], key: SigningKey
) -> dict[str, Path]:
    """Sign the files of a report in a folder; return the paths of the statement and of its signature.

    Raises `UsageError` if a file cannot be read or written.
    """
    entries = entries_of(folder) or {path.name: content_of(path) for path in report}
    others = {RECORDING, STATEMENT, SIGNATURE}
    statement = _Statement(
        signer=key.name,
        public_key=str(key.public),
        signed_utc=datetime.now(UTC).replace(microsecond=0),
        unit=facts.meta.unit.serial,
        verdict=acceptance.verdict,
        recording=_Recording(name=facts.name, digest=facts.digest),
        files={name: _File.model_validate(entry) for name, entry in entries.items() if name not in others},
    )
    content = f"{statement.model_dump_json(by_alias=True, indent=1)}\n".encode()
    files = {"statement": (STATEMENT, content), "signature": (SIGNATURE, key.sign(content).encode())}
    for name, data in files.values():
        with whole_file(folder / name) as temporary:
            temporary.write_bytes(data)
    return {kind: folder / name for kind, (name, _) in files.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Signature:
    """A signature that matches its statement.

    `name` is the signer's: as the list of allowed signers gives it if `accepted_by`, that list, accepts the key;
    otherwise as the signer wrote it. `recording` is the name of the recording that was signed.
    """

    name: str
    fingerprint: str
    signed: datetime
    unit: str
    verdict: str
    recording: str
    accepted_by: Path | None

    @property
    def says(self) -> str:
        """Who signed what, in a line."""
        when = f"{self.signed:%Y-%m-%d %H:%M} UTC"
        return f"signed by {self.name}, key {self.fingerprint}, {when}: {self.verdict}, {self.unit}"


def check_signed(
    folder: Path, recording_digest: str | None, signers: Path | None
) -> tuple[Signature | None, list[Mismatch]]:
    """Return the signature in a folder, None if there is none that matches, and every difference from what it signs.

    `recording_digest` is the digest of the present recording, None if there is none to compare. With a list of allowed
    `signers`, a missing signature and one by a key that it does not accept are problems. Raises `UsageError` if that
    list cannot be used.
    """
    missing = [name for name in (STATEMENT, SIGNATURE) if not (folder / name).is_file()]
    if len(missing) == 2:
        return None, [Mismatch(SIGNATURE, "is not there: the acceptance is not signed")] if signers else []
    if missing:
        return None, [Mismatch(missing[0], "was deleted, the signature cannot be checked")]
    content = read_whole(folder / STATEMENT, MOST_DESCRIPTION_BYTES, "statement ")
    armoured = read_whole(folder / SIGNATURE, MOST_DESCRIPTION_BYTES, "signature ")
    try:
        key = signed_by(content, armoured.decode("ascii", errors="replace"))
    except UsageError as err:
        return None, [Mismatch(SIGNATURE, str(err))]
    try:
        statement = _Statement.model_validate_json(content)
    except ValidationError:
        return None, [Mismatch(STATEMENT, f"is no statement of schema {_SCHEMA!r}; update benchctl")]
    name = accepted_name(signers, key, statement.signed_utc) if signers else None
    signature = Signature(
        name=printable(name or statement.signer),
        fingerprint=key.fingerprint,
        signed=statement.signed_utc,
        unit=printable(statement.unit),
        verdict=printable(statement.verdict),
        recording=printable(statement.recording.name),
        accepted_by=signers if name else None,
    )
    problems = list(_differences(folder, statement.files))
    if statement.public_key != str(key):
        problems.append(Mismatch(SIGNATURE, f"is by {key.fingerprint}, not by the key that {STATEMENT} names"))
    if signers and name is None:
        signed = f"{key.fingerprint} on {statement.signed_utc:%Y-%m-%d}"
        problems.append(Mismatch(SIGNATURE, f"was made with key {signed}, which {signers} does not accept"))
    if recording_digest not in (None, statement.recording.digest):
        problems.append(Mismatch("recording", f"is not the one that was signed: its digest is {recording_digest}"))
    return signature, problems


def _differences(folder: Path, files: Mapping[str, _File]) -> Iterable[Mismatch]:
    for name, signed in files.items():
        path = folder / name
        if not path.resolve().is_relative_to(folder.resolve()) or not path.is_file():
            yield Mismatch(printable(name), "is not there, and was signed")
            continue
        try:
            found = integrity(signed.model_dump(), path)
        except OSError as err:
            yield Mismatch(printable(name), f"cannot be read: {reason(err)}")
            continue
        if found == "altered":
            yield Mismatch(printable(name), "changed since it was signed")
