import inspect

import pytest

from instruments.catalog import driver, models, twin
from instruments.errors import UsageError


def test_every_model_of_ours_has_a_driver_and_a_simulated_twin() -> None:
    assert models("rate_table") == ("acutrol3000",)
    assert models("chamber") == ("watlow_f4", "watlow_f4t")
    assert models("digitizer") == ("labjack_t7",)
    for kind in ("rate_table", "chamber", "digitizer"):
        for model in models(kind):
            assert isinstance(driver(kind, model), type)
            assert isinstance(twin(kind, model), type)


def test_every_driver_says_that_it_was_not_tried_on_hardware() -> None:
    for kind in ("rate_table", "chamber", "digitizer"):
        for model in models(kind):
            found = driver(kind, model)
            text = f"{inspect.getmodule(found).__doc__} {found.__doc__}"
            assert "not tried on hardware" in " ".join(text.split()).lower()


@pytest.mark.parametrize(
    ("model", "says"),
    [
        ("watlow_f5", "did you mean watlow_f4"),
        ("quantities", "there is no 'quantities'"),
        ("../etc", "there are watlow_f4, watlow_f4t"),
        ("", "there are watlow_f4, watlow_f4t"),
    ],
)
def test_a_model_that_is_none_is_named_with_those_there_are(model: str, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        driver("chamber", model)
