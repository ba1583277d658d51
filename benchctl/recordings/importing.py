"""Brings a foreign recording into our own file: finds out what it is, reads it, writes it whole or not at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchctl.recordings.column_map import ColumnMap, read_map
from benchctl.recordings.import_mat import read_mat
from benchctl.recordings.import_open import (
    is_open_recording,
    read_description,
    read_open_recording,
    samples_of,
)
from benchctl.recordings.import_records import read_json, read_sqlite
from benchctl.recordings.import_table import read_table
from benchctl.recordings.mapped import build_recording
from benchctl.recordings.model import Meta, Step
from benchctl.recordings.static_points import build_points, map_by_header
from benchctl.recordings.text_file import sources_json
from benchctl.recordings.writer import write_recording
from benchctl_instruments.errors import UsageError

_READERS = {".mat": read_mat, ".json": read_json, **dict.fromkeys((".db", ".sqlite", ".sqlite3"), read_sqlite)}
_TEXTS = (".csv", ".txt", ".log", ".tsv", ".dat", ".asc")
_OURS = (".h5", ".hdf5")


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """What an import made: the file, how many steps and samples it has, and in words what was done to the stamps."""

    output: Path
    meta: Meta
    steps: int
    samples: int
    treatment: str


def import_recording(source: Path, map_file: Path | None, output: Path) -> Imported:
    """Write a foreign recording as a file of ours.

    Parameters
    ----------
    source
        An open recording's folder, delimited text (`.gz` or not), a MAT file, JSON or an SQLite database.
    map_file
        Which column is which (`map_examples`); an open recording and a table of static points with our names need none.
    output
        The HDF5 file to be; it appears when it is whole, and never otherwise.

    Raises
    ------
    UsageError
        One line that names the file and the place at fault.
    """
    meta, steps = read_foreign(source, map_file)
    write_recording(output, meta, steps)
    return Imported(
        output=output,
        meta=meta,
        steps=len(steps),
        samples=sum(step.info.samples for step in steps),
        treatment=meta.provenance.get("treatment", ""),
    )


def read_foreign(source: Path, map_file: Path | None = None) -> tuple[Meta, list[Step]]:
    """A foreign recording in memory; raises `UsageError` as `import_recording` does."""
    if not source.exists():
        raise UsageError(f"{source}: there is no such file or folder; correct the name")
    if map_file is None:
        return _read_unmapped(source)
    mapping, text = read_map(map_file)
    sources = [source]
    if source.is_dir():
        beside = read_description(source)
        sources = [source / "recording.json", samples_of(source)]
        meta, steps = build_recording(read_table(sources[1], mapping), mapping, str(map_file), beside)
    else:
        raw = _READERS.get(source.suffix.lower(), read_table)(source, mapping)
        build = build_points if mapping.points is not None else build_recording
        meta, steps = build(raw, mapping, str(map_file))
    return _with_sources(meta, sources, map=text), steps


def _read_unmapped(source: Path) -> tuple[Meta, list[Step]]:
    if source.is_dir():
        if not is_open_recording(source):
            raise UsageError(f"{source}: no open recording, expected a folder with recording.json")
        return read_open_recording(source)
    kind = _kind(source)
    if kind in _OURS:
        raise UsageError(f"{source}: is an HDF5 file; every command takes those of benchctl as they are")
    if kind in _TEXTS and (mapping := map_by_header(source)) is not None:
        return _read_points(source, mapping)
    raise UsageError(
        f"{source}: which column is which is not known; name a map file (--map), `benchctl import --help` shows one for"
        " text, MAT, JSON and SQLite (an open recording's folder, or a CSV with the columns rate_dps and gyro_v_mean,"
        " needs none)"
    )


def _read_points(source: Path, mapping: ColumnMap) -> tuple[Meta, list[Step]]:
    meta, steps = build_points(read_table(source, mapping), mapping, str(source))
    return _with_sources(meta, [source]), steps


def _with_sources(meta: Meta, sources: Sequence[Path], **further: str) -> Meta:
    return replace(meta, provenance={**meta.provenance, "sources": sources_json(sources), **further})


def _kind(source: Path) -> str:
    """The ending that tells what a file is, without `.gz`."""
    return Path(source.name.removesuffix(".gz")).suffix.lower()
