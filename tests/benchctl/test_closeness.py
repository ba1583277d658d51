import pytest

from benchctl.closeness import meant, nearest


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("pionts", "did you mean points?"),
        ("POINTS", "did you mean points?"),
        ("xyz", "there are points, soak_s"),
        ("", "there are points, soak_s"),
    ],
)
def test_the_end_of_an_error_names_what_was_meant_or_all_there_is(name: str, says: str) -> None:
    assert meant(name, ["points", "soak_s"]) == says


def test_nothing_to_choose_from_is_said_too() -> None:
    assert meant("x", []) == "there are none"
    assert meant("x", ["points"], "look at the help") == "look at the help"


def test_what_is_near_is_given_as_it_is_written() -> None:
    assert nearest("k0_v_per_dsp", ["K0_v_per_dps", "U0_v"]) == "K0_v_per_dps"
    assert nearest("zzz", ["K0_v_per_dps"]) == ""
