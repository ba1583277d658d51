"""From a TOML file to a chamber profile, or to one line that names the file and the field that is wrong."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from benchctl_instruments.chambers.profile import Profile
from benchctl_instruments.chambers.profile_rules import contradiction
from benchctl_instruments.errors import UsageError, in_line, reason
from benchctl_instruments.field_faults import field_fault

LONGEST_SHOWN = 60
MOST_BYTES = 1 << 17
"""Of a profile; ours have 2000."""
MOST_DOTS = 200
"""In a line. The time that Python's TOML reader takes for a dotted key grows with the square of its parts."""


def profile_name(path: str | Path) -> str:
    """What errors call the profile in a file."""
    return _one_line(f"chamber profile {path}")


def profile_text(path: Path) -> str:
    """The text of a profile's file.

    Raises
    ------
    UsageError
        Where it cannot be read, is no file (a pipe might never end), not UTF-8, or too large to have been meant.
    """
    name = profile_name(path)
    try:
        if path.exists() and not path.is_file():
            raise UsageError(f"{name}: cannot be read: it is no file; name one")
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        text = content.decode("utf-8")
    except OSError as err:
        raise UsageError(f"{name}: cannot be read: {reason(err)}") from err
    except ValueError as err:  # not UTF-8, or a name that no file can have
        raise UsageError(f"{name}: cannot be read as UTF-8 text: {_one_line(str(err))}") from err
    if len(content) > MOST_BYTES:
        raise UsageError(f"{name}: is larger than {MOST_BYTES >> 10} KiB, which no profile needs")
    return text


@cache
def shipped_profile(name: str) -> Profile:
    """One of the profiles that come with the drivers."""
    text = files("benchctl_instruments.chambers.profiles").joinpath(f"{name}.toml").read_text(encoding="utf-8")
    return parse_profile(text, f"chamber profile {name}.toml")


def parse_profile(text: str, name: str) -> Profile:
    """The profile that a TOML text declares; `name` is what errors call the text.

    Raises
    ------
    UsageError
        Where it is too large, is not TOML, or declares what cannot be; names the first wrong field.
    """
    if len(text) > MOST_BYTES:
        raise UsageError(f"{name}: {len(text)} characters, expected at most {MOST_BYTES}")
    for number, line in enumerate(text.split("\n"), 1):
        if (dots := line.count(".")) > MOST_DOTS:
            raise UsageError(f"{name}, line {number}: {dots} dots, expected at most {MOST_DOTS} in a line")
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as err:  # also numbers of thousands of digits, and nesting as deep
        raise UsageError(f"{name}: not TOML: {_one_line(in_line(str(err)))}") from err
    return profile_of(document, name)


def changed(profile: Profile, changes: Mapping[str, Any], name: str) -> Profile:
    """A profile with some of its fields given anew, table by table; lists are replaced as a whole."""
    if not isinstance(changes, Mapping):
        raise UsageError(f"{name}: expected a table with fields of the profile, got {_shown(changes)}")
    document = profile.model_dump(exclude_unset=True)
    if isinstance(changes.get("switch"), Mapping) and "by" in changes["switch"]:
        document.pop("switch", None)  # another kind of switch has other fields
    return profile_of(_merged(document, changes), name)


def profile_of(document: Mapping[str, Any], name: str) -> Profile:
    """The profile that a document declares; `name` is what errors call it."""
    try:
        profile = Profile.model_validate(document)
    except ValidationError as err:
        raise UsageError(f"{name}, {_first_fault(err)}") from err
    if says := contradiction(profile):
        raise UsageError(f"{name}, {says}")
    return profile


def _merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(below)
    for key, value in above.items():
        under = merged.get(key)
        merged[key] = _merged(under, value) if isinstance(under, Mapping) and isinstance(value, Mapping) else value
    return merged


def _first_fault(err: ValidationError) -> str:
    first, *more = err.errors(include_url=False, include_context=False)
    field = _one_line(".".join(str(part) for part in first["loc"]))
    rest = f" (and {len(more)} more)" if more else ""
    return f"{field}: {_one_line(field_fault(first, _shown))}{rest}"


def _shown(value: object) -> str:
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a number of thousands of digits
        return "a number that is far too long"
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."


def _one_line(text: str) -> str:
    return "".join(character if character.isprintable() else " " for character in text)
