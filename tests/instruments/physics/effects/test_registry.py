"""What every effect must keep, whoever adds it: this walks the registry."""

from __future__ import annotations

import re

import pytest

from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.effect_contract.behaviour import PROMISES
from benchctl_instruments.physics.effect_contract.description import faults_in
from benchctl_instruments.physics.effects.effect import PhysicalEffect
from benchctl_instruments.physics.effects.registry import effect, effects
from tests.shared import SHARED, needs_shared

every = pytest.mark.parametrize("kind", effects().values(), ids=lambda kind: kind.identifier)


@needs_shared("spec/effects.md")
def test_the_vocabulary_is_there_under_its_own_names() -> None:
    rows = re.findall(r"^\| `(\w+)` \|.*\| (.+) \|$", (SHARED / "spec" / "effects.md").read_text("utf-8"), re.M)
    assert len(rows) > 20
    for identifier, parameters in rows:
        named, ours = re.findall(r"`(\w+)`", parameters), effect(identifier).parameters
        if " or " in parameters:
            assert set(ours) <= set(named), identifier
        else:
            assert list(ours)[: len(named)] == named, identifier
            # what the vocabulary does not name, an angle or a choice (the distribution of spikes) at most
            further = [parameter.role for name, parameter in ours.items() if name not in named]
            assert set(further) <= {"phase", "choice"}, identifier


@every
def test_it_describes_itself(kind: type[PhysicalEffect]) -> None:
    assert list(faults_in(kind, kind.identifier)) == []
    assert effects()[kind.identifier] is kind
    assert set(kind.look_alikes) <= set(effects()) - {kind.identifier}


@every
def test_it_keeps_what_it_promises(kind: type[PhysicalEffect]) -> None:
    for promise in PROMISES:  # the traceback of one that is broken begins with its name
        promise(kind)


def test_an_effect_that_is_not_there_is_said_so() -> None:
    with pytest.raises(UsageError, match=r"'gremlins': there is no such effect; there are adc_coarse, .*, warm_up$"):
        effect("gremlins")
