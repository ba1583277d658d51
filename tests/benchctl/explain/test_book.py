"""Every entry is found by its name, and by what else people call it."""

from __future__ import annotations

import pytest

from benchctl.explain.book import entries, find, grouped
from benchctl_instruments.errors import UsageError

SPELT = {
    "thermal_lag": ["thermal_lag", "Thermal Lag", "THERMAL-LAG", "  thermal   lag ", "thermalLag"],
    "angle_random_walk": ["ARW", "arw", "N", "Angle random walk", "angle-random-walk"],
    "bias_instability": ["bias instability", "B", "Bias-Instability B"],
    "quantisation": ["Q", "quantization", "Quantization Noise", "quantisation noise"],
    "k = 2": ["k", "k=2", "k = 2", "coverage factor"],
    "K0": ["K0", "k0", "K₀", "K0_v_per_dps"],
    "expanded uncertainty": ["U", "expanded uncertainty"],
    "standard uncertainty": ["u"],
    "set point": ["set point", "setpoint", "set-point", "Set Points"],
    "INCONCLUSIVE": ["INCONCLUSIVE", "inconclusive"],
    "missing-physics": ["missing-physics", "missing physics", "missing_physics"],
    "encoder_eccentricity": ["encoder eccentricity", "eccentricity"],
    "E_n": ["E_n", "En", "en"],
    "outliers": ["outlier", "outliers", "spike"],
    "scale_ageing": ["scale aging", "scale ageing"],
    "role verify": ["role verify", "verify role"],
    "nonlinearity_reading": ["nonlinearity of reading"],
    "bench.toml": ["bench.toml", "bench toml"],
}


@pytest.mark.parametrize(("name", "spelling"), [(name, one) for name, every in SPELT.items() for one in every])
def test_any_spelling_finds_it(name: str, spelling: str) -> None:
    assert [one.name for one in find(spelling)] == [name]


@pytest.mark.parametrize(
    ("word", "names"),
    [
        ("deadband", ["dead_zone", "dead_zone"]),
        ("dead zone", ["dead_zone", "dead_zone"]),
        ("bias_temperature", ["bias_temperature", "bias_temperature"]),
        ("K", ["scale_factor", "rate_random_walk"]),
        ("guard", ["guard band", "guard process"]),
    ],
)
def test_of_a_word_with_several_meanings_all_are_told(word: str, names: list[str]) -> None:
    assert [one.name for one in find(word)] == names


def test_every_entry_is_found_by_its_name_its_title_and_every_other_spelling_of_it() -> None:
    for entry in entries():
        assert entry in find(entry.name)
        assert entry in find(entry.title)
        for spelling in entry.also:
            assert find(spelling), spelling


def test_no_spelling_is_hidden_by_another_entrys_name() -> None:
    hidden = [(entry.name, spelling) for entry in entries() for spelling in entry.also if entry not in find(spelling)]
    assert hidden == []


@pytest.mark.parametrize(
    ("word", "near"),
    [("termal_lag", "thermal_lag"), ("scale facter", "scale factor"), ("INCONCLUSIV", "INCONCLUSIVE")],
)
def test_an_unknown_term_is_one_line_with_what_was_probably_meant(word: str, near: str) -> None:
    with pytest.raises(UsageError) as caught:
        find(word)
    assert str(caught.value).lower() == f"explain '{word.lower()}': there is no such term: did you mean {near.lower()}?"


@pytest.mark.parametrize("word", ["xqzzyk", "", "---", "§§§", "x" * 100_000])
def test_where_nothing_is_near_it_says_how_to_list_all(word: str) -> None:
    with pytest.raises(UsageError, match="there is no such term: benchctl explain lists them"):
        find(word)


def test_no_two_entries_of_a_group_share_a_name_and_every_group_has_some() -> None:
    for group, members in grouped().items():
        names = [one.name for one in members]
        assert names, group
        assert len(set(names)) == len(names)
