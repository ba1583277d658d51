"""Write a package with a driver to fill in, its simulated instrument, and a test that passes without changes.

The templates are in `templates/KIND/PROTOCOL`: paths and texts of the files of the package. `NAME` in a path and
`$name` in a text are the model, `$class_name` and `$title` the same as a class and in words.
"""

from __future__ import annotations

import importlib.util
import keyword
import re
from collections.abc import Iterator
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from string import Template
from typing import Literal

from benchctl.atomic import whole_folder
from benchctl_instruments.catalog import Kind, models
from benchctl_instruments.errors import UsageError

Protocol = Literal["modbus", "lines"]
KIND: Kind = "chamber"
_FILE = ".in"


def new_instrument(kind: str, name: str, folder: Path, protocol: Protocol = "modbus") -> list[Path]:
    """Write the package of a new model into a new folder, and return the paths of its files.

    Raises
    ------
    UsageError
        If there is no template for the kind, the name cannot be one of a package or is taken, or the folder cannot be
        written or is not empty.
    """
    if kind != KIND:
        raise UsageError(
            f"new {kind}: expected {KIND}, there are no templates of other kinds; begin with a copy of the driver in"
            " benchctl_instruments that is most like it"
        )
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or keyword.iskeyword(name):
        raise UsageError(f"new {kind} {name}: expected a name of small letters, digits and _, for example acme_9000")
    found = importlib.util.find_spec(name)
    if name in models(KIND) or (found is not None and found.origin is not None):  # a mere folder has no origin
        raise UsageError(f"new {kind} {name}: a model or package of that name is installed; give it another name")
    words = name.split("_")
    meaning = {
        "name": name,
        "class_name": "".join(map(str.capitalize, words)),
        "title": " ".join(map(str.capitalize, words)),
    }
    templates = files("benchctl.app").joinpath("templates", kind)
    written = []
    with whole_folder(folder) as temporary:
        for part in ("both", protocol):
            for path, text in _texts(templates.joinpath(part)):
                place = Path(path.replace("NAME", name))
                (temporary / place).parent.mkdir(parents=True, exist_ok=True)
                (temporary / place).write_text(Template(text).substitute(meaning), encoding="utf-8")
                written.append(folder / place)
    return sorted(written)


def _texts(folder: Traversable, path: str = "") -> Iterator[tuple[str, str]]:
    """Yield the paths below a folder of templates, without their ending, and their texts."""
    for entry in folder.iterdir():
        if entry.is_dir():
            yield from _texts(entry, f"{path}{entry.name}/")
        elif entry.name.endswith(_FILE):
            yield f"{path}{entry.name.removesuffix(_FILE)}", entry.read_text(encoding="utf-8")
