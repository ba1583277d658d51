"""Check that a recording and its acceptance are unchanged, and by whom the acceptance was signed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchctl.recordings.campaign_manifest import MANIFEST, manifest_digest
from benchctl.recordings.hdf5_files import RecordingFile
from benchctl.recordings.schema import CAMPAIGN, RECORDING
from benchctl.recordings.verify import verify as problems_of
from benchctl.reports.acceptance.signed import STATEMENT, Signature, check_signed
from benchctl.reports.results import results_folder
from benchctl_instruments.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class Verified:
    """What was found; `print` shows the text of `benchctl verify` for a recording without problems.

    `campaign_digest` is that of a campaign's manifest. `signature` is None if there is none that matches its statement.
    `has_recording` is False if only the folder of a report was checked.
    """

    path: Path
    problems: tuple[str, ...]
    campaign_digest: str | None
    signature: Signature | None
    has_recording: bool

    def values(self) -> dict[str, Any]:
        """Return the data for `--json`."""
        signature = self.signature and {
            "name": self.signature.name,
            "fingerprint": self.signature.fingerprint,
            "signed_utc": self.signature.signed.isoformat(),
            "unit": self.signature.unit,
            "verdict": self.signature.verdict,
            "accepted_by": self.signature.accepted_by,
        }
        return {
            "recording": self.path,
            "problems": list(self.problems),
            "campaign_digest": self.campaign_digest,
            "signature": signature,
        }

    def __str__(self) -> str:
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        if self.has_recording:
            yield f"{self.path}: nothing changed since it was written{self._reach()}"
        if (signature := self.signature) is None:
            return
        if not self.has_recording:
            yield f"{self.path}: no signed file changed; the recording {signature.recording} is elsewhere, not checked"
        yield signature.says
        if signature.accepted_by is None:
            yield "the signature matches; whose key it is was not checked: --signers FILE lists the accepted keys"
        else:
            yield f"the key is listed in {signature.accepted_by}"

    def _reach(self) -> str:
        """Return a text that states the extent of the check of a campaign's folder."""
        if self.campaign_digest is not None:
            return f"; campaign digest {self.campaign_digest}"
        return " (its steps; the campaign is not closed, and so has no manifest yet)" if self.path.is_dir() else ""


def verify(path: Path, *, signers: Path | None = None) -> Verified:
    """Check the digests of a recording or a campaign, and the signature of its acceptance, if there is one.

    `path` may also be the folder of a signed report alone. `signers` is a list of the keys that are accepted, in
    OpenSSH's format of allowed signers; with it, a missing signature is a problem too.

    Raises
    ------
    UsageError
        As `benchctl.recordings.verify.verify` does, or if the list of signers cannot be used.
    """
    has_recording = not (path / STATEMENT).is_file() or any(
        (path / name).exists() for name in (MANIFEST, RECORDING, CAMPAIGN)
    )
    problems = problems_of(path) if has_recording else []
    signature, unsigned = check_signed(results_folder(path, "acceptance"), _digest_of(path), signers)
    known = {problem.where for problem in unsigned}
    return Verified(
        path=path,
        problems=tuple(map(str, [*unsigned, *(one for one in problems if one.where not in known)])),
        campaign_digest=manifest_digest(path),
        signature=signature,
        has_recording=has_recording,
    )


def _digest_of(path: Path) -> str | None:
    """Return the digest of a recording; None if there is none, or it cannot be read."""
    try:
        with closing(RecordingFile(path / RECORDING if path.is_dir() else path)) as recording:
            return recording.digest
    except UsageError:
        return None
