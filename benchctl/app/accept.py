"""Judge a recording by a file of limits, and write the files of the report."""

from __future__ import annotations

import os
import unicodedata
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from benchctl.limits import cut
from benchctl.metrology.acceptance import accepted
from benchctl.metrology.limit_file import Limits, read_limits
from benchctl.metrology.result import Acceptance, Judged, Verdict
from benchctl.recordings.campaign_manifest import add_to_manifest
from benchctl.recordings.verify import opened_unchanged
from benchctl.reports.acceptance.build import tally
from benchctl.reports.acceptance.catalogue import catalogue, limits, stated, verdict_of
from benchctl.reports.acceptance.set_up import RecordingFacts, facts_of
from benchctl.reports.acceptance.signed import refuse_unsignable, write_signed
from benchctl.reports.acceptance.write import values, write_acceptance
from benchctl.sshsig import SigningKey, read_signing_key
from benchctl_instruments.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class Accepted:
    """An acceptance and the facts of its recording; `print` shows the text of `benchctl accept`.

    `language` is that of text and report. `files` are the paths of `report`, `pdf`, `junit` and `json`, if they were
    written, and of `statement` and `signature`, if they were signed.
    """

    acceptance: Acceptance = field(repr=False)
    facts: RecordingFacts = field(repr=False)
    language: str = "en"
    files: Mapping[str, Path] = field(default_factory=dict)

    @property
    def verdict(self) -> Verdict:
        """The overall verdict: PASS only if every test with a limit passes."""
        return self.acceptance.verdict

    @property
    def tests(self) -> tuple[Judged, ...]:
        """The tests: `measured` (value, expanded uncertainty at 95.45 %, unit), `limit`, and each one's `verdict`.

        The latter is PASS, FAIL, INCONCLUSIVE, or None without a limit.
        """
        return self.acceptance.judged

    def __str__(self) -> str:
        return lines(self.acceptance, self.language)

    def values(self) -> dict[str, Any]:
        """Return the data for `--json`."""
        return values(self.acceptance, self.facts)

    def write(self, folder: Path, key: SigningKey | None = None) -> Accepted:
        """Write the report into a folder and its manifest, sign it, and return the acceptance with the paths.

        Raises as `write_acceptance` does, and `UsageError` if there is a `key` and the recording cannot be signed.
        """
        if key is not None:
            refuse_unsignable(folder, self.facts)
        files = write_acceptance(self.acceptance, self.facts, folder, self.language, key)
        add_to_manifest(folder, files.values())
        if key is not None:
            signed = write_signed(folder, self.acceptance, self.facts, files.values(), key)
            add_to_manifest(folder, signed.values())
            files |= signed
        return replace(self, files=files)

    @property
    def fails(self) -> str:
        """The reason why the verdict is not PASS, in a few words; empty for PASS."""
        open_ones = [one.measured.name for one in self.tests if one.verdict == "INCONCLUSIVE"]
        failed = [one.measured.name for one in self.tests if one.verdict == "FAIL"]
        if failed:
            return f"fails {', '.join(failed)}"
        return f"inconclusive: {', '.join(open_ones)}" if open_ones else ""


def accept(path: Path, limits: Limits | Path, *, language: str = "en") -> Accepted:
    """Measure and judge a recording by limits, or by a file of them.

    Raises
    ------
    UsageError
        If it cannot be read, was changed, or contains no reading at all, or if the limits cannot be used.
    """
    read = limits if isinstance(limits, Limits) else read_limits(limits)
    with opened_unchanged([path], "accepted") as (recording,):
        found = Accepted(acceptance=accepted(recording, read), facts=facts_of(recording), language=language)
    return found


_VARIABLE = "BENCHCTL_PASSPHRASE"


def signing_key(path: Path, ask: Callable[[], str] | None = None) -> SigningKey:
    """Read an OpenSSH key; its passphrase, if it has one, comes from `$BENCHCTL_PASSPHRASE`, or from `ask`.

    Raises as `read_signing_key` does, and `UsageError` if the passphrase is needed and comes from neither.
    """

    def passphrase() -> str:
        if (given := os.environ.get(_VARIABLE)) is not None:
            return given
        if ask is None:
            raise UsageError(f"key {path}: needs its passphrase, there is no terminal to ask at; set {_VARIABLE}")
        return ask()

    return read_signing_key(path, passphrase)


_WIDEST = 120
_GAP = 2


def lines(acceptance: Acceptance, language: str = "en") -> str:
    """Return a line per test with name, value ± U, limit and verdict; only the last may exceed 120 characters."""
    words = catalogue(language)
    names = [plain(words.test(one.measured.name).name) for one in acceptance.judged]
    columns = [
        [plain(stated(one.measured, words)) for one in acceptance.judged],
        [plain(limits(one.limit, words, unit=False)) for one in acceptance.judged],
        [verdict_of(one, words) for one in acceptance.judged],
    ]
    widths = [max(map(len, column), default=0) for column in columns]
    room = _WIDEST - sum(widths) - _GAP * len(widths)
    names = [cut(name, room) for name in names]
    widths.insert(0, max(map(len, names), default=0))
    rows = [
        "".join(cell.ljust(width + _GAP) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in zip(names, *columns, strict=True)
    ]
    verdict = words.word(f"unit_{acceptance.verdict}", "verdicts")
    return "\n".join([*rows, f"{verdict}. {tally(acceptance, words)}"])


def plain(cell: str) -> str:
    """Return the text with only printable characters, whitespace replaced by spaces."""
    return "".join(" " if one.isspace() else one for one in cell if not unicodedata.category(one).startswith("C"))
