"""Which sketch belongs to an entry: of an effect by its registry, of others by the name that the glossary states."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from benchctl.explain.entry import Entry
from benchctl.explain.pictures import made_noise, made_terms, made_tests
from benchctl.explain.pictures.chamber_effects import chamber_sketch
from benchctl.explain.pictures.drive_effects import drive_sketch
from benchctl.explain.pictures.gyro_effects import gyro_sketch
from benchctl.explain.pictures.sketch import Sketch
from benchctl_instruments.physics.chamber_effects.registry import chamber_effects
from benchctl_instruments.physics.drive_effects.registry import drive_effects
from benchctl_instruments.physics.effects.registry import effects

MADE: Mapping[str, Callable[[], Sketch]] = {
    made.__name__: made
    for made in (
        made_tests.scale_factor,
        made_tests.nonlinearity,
        made_tests.input_range,
        made_tests.turn_ons,
        made_tests.hysteresis_rate,
        made_tests.hysteresis_bias,
        made_tests.threshold,
        made_tests.misalignment,
        made_noise.bias,
        made_noise.bias_stability,
        made_noise.whitening,
        made_terms.convention,
        made_terms.argument,
        made_terms.error_path,
        made_terms.coverage,
        made_terms.guard_band,
        made_terms.e_n,
        made_terms.control_chart,
        made_terms.soak,
        made_terms.bandwidth,
        made_terms.warm_up_time,
    )
}
"""The pictures that are no effect's, by the name under which `terms/*.toml` asks for them; `allan:N` stands beside."""


def sketch_of(entry: Entry) -> Sketch:
    """The sketch of an entry that has a drawing."""
    kind, _, name = entry.drawing.partition(":")
    if kind == "effect":
        return effect_sketch(name)
    return made_noise.allan(name) if kind == "allan" else MADE[kind]()


def effect_sketch(identifier: str) -> Sketch:
    """The sketch of an effect of any part of the bench."""
    if identifier in effects():
        return gyro_sketch(effects()[identifier])
    if identifier in drive_effects():
        return drive_sketch(drive_effects()[identifier])
    return chamber_sketch(chamber_effects()[identifier])
