"""Every effect of every part of the bench has a picture that shows it."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchctl.explain.book import find
from benchctl.explain.pictures.drawn import effect_sketch, figure_of, write_picture
from benchctl.explain.pictures.sketch import Sketch
from benchctl.reports.figures import style
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chamber_effects.registry import chamber_effects
from benchctl_instruments.physics.drive_effects.registry import drive_effects
from benchctl_instruments.physics.effects.registry import effects

sketch_of_effect = cache(effect_sketch)
EVERY = [*effects(), *drive_effects(), *chamber_effects()]
SEEN = 0.03
"""Of the height of some panel: what an eye sees without looking for it."""


def parted(sketch: Sketch) -> float:
    """By how much the curves of a panel part at most, as a share of its height; the largest over the panels."""
    shares = [0.0]
    for panel in sketch.panels:
        off = [curve for curve in panel.curves if curve.look.startswith(("off", "grey"))]
        on = [curve for curve in panel.curves if curve.look.startswith("on")]
        if not (off and on):
            continue
        values = np.concatenate([np.log(curve.y) if panel.logarithmic else curve.y for curve in (*off, *on)])
        for without, within in zip(off, on, strict=False):
            if without.x.shape == within.x.shape:
                pair = [np.log(one.y) if panel.logarithmic else one.y for one in (without, within)]
                shares.append(float(np.max(np.abs(pair[1] - pair[0])) / np.ptp(values)))
    return max(shares)


@pytest.mark.parametrize("identifier", EVERY)
def test_the_picture_of_an_effect_shows_it(identifier: str) -> None:
    sketch = sketch_of_effect(identifier)
    assert np.isfinite(sketch.difference).all()
    assert float(np.max(np.abs(sketch.difference))) > 0.0
    assert parted(sketch) > SEEN
    for name in find(identifier)[0].effect.parameters:  # type: ignore[union-attr]
        assert f"{name} = " in sketch.caption


@pytest.mark.parametrize("identifier", EVERY)
def test_every_axis_of_an_effects_picture_says_what_and_in_which_unit(identifier: str) -> None:
    for panel in sketch_of_effect(identifier).panels:
        assert re.search(r"\(.+\)$", panel.x), panel.x
        assert re.search(r"\(.+\)$", panel.y), panel.y


def test_an_effect_that_is_small_beside_the_output_is_drawn_larger_and_the_picture_says_so() -> None:
    sketch = sketch_of_effect("scale_asymmetry")
    labels = [curve.label for panel in sketch.panels for curve in panel.curves]
    assert any(re.fullmatch(r"with it, \d+ × as large", label) for label in labels)
    assert sketch.caption.endswith("Below: what it really changes.")
    (below,) = sketch.panels[-1].curves
    np.testing.assert_allclose(below.y, 1e3 * sketch.difference)


def test_the_pictures_of_two_effects_that_are_alike_in_a_reversal_are_alike() -> None:
    shift, strain = (sketch_of_effect(name).difference for name in ("timing_offset", "angular_acceleration"))
    assert abs(float(np.corrcoef(shift, strain)[0, 1])) > 0.8


def test_the_lagging_coil_is_drawn_beside_its_thermistor() -> None:
    stimulus = sketch_of_effect("thermal_lag").panels[0]
    thermistor, coil = stimulus.curves
    assert (thermistor.label, coil.label) == ("thermistor", "coil")
    assert float(np.max(np.abs(thermistor.y - coil.y))) > 1.0


def test_the_allan_deviation_of_a_wandering_bias_rises_where_white_noise_falls() -> None:
    allan = sketch_of_effect("bias_random_walk").panels[-1]
    off, on = (next(curve for curve in allan.curves if curve.look == look) for look in ("off", "on"))
    late = off.x > 300.0
    assert (on.y[late] > 5.0 * off.y[late]).all()
    assert on.y[0] == pytest.approx(off.y[0], rel=0.05)


@pytest.mark.parametrize("spelt", [("thermal lag", "thermal_lag"), ("dead zone", "dead_zone"), ("soak", "thermal_lag")])
def test_a_term_is_drawn_by_its_effect_in_the_same_bytes_each_time(spelt: tuple[str, str], tmp_path: Path) -> None:
    for place, term in enumerate(spelt):
        write_picture(term, tmp_path / f"{place}.png")
    assert (tmp_path / "0.png").read_bytes() == (tmp_path / "1.png").read_bytes()


def test_without_a_picture_it_says_so(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"explain digest: there is no picture of it"):
        write_picture("digest", tmp_path / "digest.svg")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("identifier", EVERY)
def test_every_picture_can_be_drawn(identifier: str) -> None:
    with style():
        figure = figure_of(sketch_of_effect(identifier))
        figure.draw_without_rendering()
    assert all(axes.has_data() for axes in figure.axes)
