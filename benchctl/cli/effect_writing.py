"""`benchctl diagnose --write-effect`: what was modelled and has no name, as the file of an effect."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from benchctl_instruments.errors import UsageError

if TYPE_CHECKING:
    from benchctl.diagnosis.result import Diagnosis


def refuse_other_effect_files(path: Path) -> None:
    """Raise `UsageError` where an effect cannot be named after a file, or has the name of one that there is."""
    from benchctl_instruments.physics.effects.registry import effects

    if path.suffix != ".py" or not path.stem.isidentifier():
        raise UsageError(
            f"--write-effect {path}: the effect is named after the file; expected a name such as mode_hop.py"
        )
    if path.stem in effects():
        raise UsageError(f"--write-effect {path}: there is an effect {path.stem} already; choose another name")
    if path.exists():
        raise UsageError(f"--write-effect {path}: the file exists; choose another name, or remove it")


def write_effect(path: Path, diagnosis: Diagnosis) -> str:
    """Write the largest of the structures that were modelled; what to do with the file, in a line."""
    from benchctl.atomic import whole_file
    from benchctl.diagnosis.structures.effect_file import WRITTEN, effect_source

    models = [one for one in diagnosis.unexplained.models if one.stage in WRITTEN]
    if not models:
        return f"no structure without a name was modelled that an effect can stand for: {path} is not written"
    with whole_file(path) as temporary:
        temporary.write_text(effect_source(path.stem, models[0]), encoding="utf-8")
    return f"effect {path.stem}: {path}; complete its words and add it to the entry points benchctl.effects"
