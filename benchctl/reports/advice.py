"""What a finding does to the calibration, and what to do at the bench."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice:
    """For a lab engineer: what an effect does to a `calibration`, and what to do at the `bench`."""

    calibration: str
    bench: str


def advice_for(effect: str) -> Advice | None:
    """That for an effect; None for one of another package."""
    return _book().get(effect)


@lru_cache(maxsize=1)
def _book() -> Mapping[str, Advice]:
    text = files("benchctl.reports").joinpath("advice.toml").read_text(encoding="utf-8")
    return {name: Advice(**told) for name, told in tomllib.loads(text).items()}
