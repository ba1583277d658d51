"""The contract of all effects, and a check of it for the tests of an effect's author.

>>> from benchctl_instruments.physics.effect_contract import check_effect
>>> from benchctl_instruments.physics.effects.saturation import Saturation
>>> check_effect(Saturation)

`description` checks an effect of another package when it is loaded; its behaviour must be checked by its own tests:

    def test_my_effect_keeps_its_contract():
        check_effect(MyEffect)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from benchctl_instruments.physics.effects.effect import DescribedEffect


def check_effect(kind: type[DescribedEffect]) -> None:
    """Raise an `AssertionError` that names every violation of the contract; takes at most some seconds.

    Of effects of the drive and of the chamber only the descriptions are checked.
    """
    from benchctl_instruments.physics.effect_contract.behaviour import PROMISES
    from benchctl_instruments.physics.effect_contract.description import faults_in
    from benchctl_instruments.physics.effects.effect import PhysicalEffect
    from benchctl_instruments.physics.effects.registry import effects

    broken = list(faults_in(kind, getattr(kind, "identifier", "")))
    if not broken and issubclass(kind, PhysicalEffect):
        broken += [
            f"it looks like {other!r}, and there is no such effect"
            for other in kind.look_alikes
            if other not in effects()
        ]
        for promise in PROMISES:
            try:
                promise(kind)
            except Exception as err:  # any exception of an effect violates the contract
                broken.append(f"{' '.join((promise.__doc__ or '').split())} But: {type(err).__name__}: {err}")
    if broken:
        raise AssertionError(f"{kind.__name__} does not keep what an effect must:\n- " + "\n- ".join(broken))
