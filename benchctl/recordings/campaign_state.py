"""What a campaign's folder says of itself, whether its program runs, has ended or has died."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path

from benchctl.locks import is_held
from benchctl.recordings.hdf5_files import RecordingFile
from benchctl.recordings.journal import events_in, journal_text, last_word
from benchctl.recordings.model import Meta
from benchctl.recordings.schema import CAMPAIGN, JOURNAL, LOCK, RECORDING, STEPS
from benchctl_instruments.errors import UsageError


def described(folder: Path) -> Meta:
    """The description of a campaign as it was begun: without an end, a reason and a journal.

    It is that of the first file which can be read; each file of a step has it, too. Raises `UsageError` where none can.
    """
    unreadable: UsageError | None = None
    candidates = (folder / RECORDING, folder / CAMPAIGN, *sorted((folder / STEPS).glob("[0-9]*")))
    for file in filter(Path.exists, candidates):
        try:
            with closing(RecordingFile(file)) as opened:
                meta = opened.meta
        except UsageError as err:
            unreadable = unreadable or err
        else:
            begun = {name: text for name, text in meta.provenance.items() if name not in ("journal", "reason")}
            return replace(meta, status="running", provenance=begun)
    raise unreadable or UsageError(f"{folder}: is no campaign: expected {RECORDING} or {CAMPAIGN} in this folder")


def state_of(folder: Path) -> tuple[Meta, tuple[str, ...]]:
    """Description and notes of a campaign that is not finished: `running` only where its program does.

    `Meta.provenance` holds the journal and, of a program that has died, the `reason`.
    """
    meta = described(folder)
    journal = journal_text(folder / JOURNAL)
    provenance = {**meta.provenance, "journal": journal}
    if is_held(folder / LOCK):
        return replace(meta, provenance=provenance), ()
    status, reason = last_word(events_in(journal))
    note = (
        f"its recording is not closed ({reason or 'all steps are there'}): benchctl recover {folder} closes it, "
        f"benchctl run PROCEDURE --bench BENCH --resume {folder} goes on with it"
    )
    return replace(meta, status=status, provenance={**provenance, "reason": reason}), (note,)


def require_campaign(folder: Path) -> None:
    """Raise `UsageError` where a folder holds no campaign, or one that died before anything was described."""
    if (folder / RECORDING).exists() or (folder / CAMPAIGN).exists() or any((folder / STEPS).glob("[0-9]*")):
        return
    if (folder / STEPS).is_dir():
        raise UsageError(f"{folder}: its program died before anything was recorded; remove the folder and run anew")
    raise UsageError(f"{folder}: is no campaign: expected {RECORDING} or {CAMPAIGN} in this folder")
