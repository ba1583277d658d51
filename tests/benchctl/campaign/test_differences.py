import json
from dataclasses import asdict
from typing import Any

from benchctl.bench import template
from benchctl.campaign.again import CHOSEN_HERE
from benchctl.campaign.differences import changes, differences, flat
from benchctl.recordings.model import BenchFacts, Meta, Unit


def _meta(*, physics: Any = None, **told: Any) -> Meta:
    provenance = {
        "procedure": "rate_sweep",
        "procedure_sha256": "a" * 64,
        "procedure_source": "one\ntwo\nthree\n",
        "parameters": '{"rates": 5}',
        "bench_toml": template(),
        "bench_physics": json.dumps(physics or {"seed": 1}),
        "instruments": json.dumps({"chamber": {"serial": "4711", "firmware": "1.2", "calibrated_until": ""}}),
        "instruments_reached": "at their addresses",
        "software": json.dumps({"numpy": "2.0"}),
        "operator": "Anna",
        **told,
    }
    unit = Unit(serial="1", range_dps=175.0)
    return Meta(status="complete", unit=unit, bench=BenchFacts(sample_rate_hz=500.0), provenance=provenance)


def _found(again: Meta, expected: tuple[str, ...] = ()) -> dict[str, tuple[str, ...]]:
    """The groups in which something differs."""
    return {name: told for name, told in asdict(differences(_meta(), again, expected=expected)).items() if told}


def test_nothing_differs_from_itself() -> None:
    assert _found(_meta()) == {}


def test_each_group_says_what_was_and_what_is() -> None:
    chamber = json.dumps({"chamber": {"serial": "4711", "firmware": "1.3", "calibrated_until": "2027-01-31"}})
    again = _meta(parameters='{"rates": 6, "run_s": 5.0}', instruments=chamber, software="{}", operator="Boris")
    assert _found(again) == {
        "parameters": ("rates was 5, is 6", "run_s was not there, is 5.0"),
        "instruments": ("chamber.calibrated_until was empty, is 2027-01-31", "chamber.firmware was 1.2, is 1.3"),
        "software": ("numpy was 2.0, is not there",),
        "operator": ("operator was Anna, is Boris",),
    }


def test_another_source_is_shown_line_by_line() -> None:
    again = _meta(procedure_sha256="b" * 64, procedure_source="one\n2\nthree\n")
    told = _found(again)["procedure"]
    assert told[0] == "its source (SHA-256) was aaaaaaaaaaaa, is bbbbbbbbbbbb"
    assert told[2:] == (" one", "-two", "+2", " three")


def test_a_changed_bench_is_a_short_diff() -> None:
    told = _found(_meta(bench_toml=template().replace("adc_bits = 16", "adc_bits = 24")))["bench"]
    assert "-adc_bits = 16" in told
    assert "+adc_bits = 24" in told
    assert len(told) == 5


def test_a_long_diff_is_cut_and_a_hopeless_one_is_not_begun() -> None:
    told = _found(_meta(bench_toml="\n".join(f"k{n} = 1" for n in range(400))))["bench"]
    assert len(told) == 21
    assert told[-1].startswith("… and ")
    told = _found(_meta(bench_toml="x = 1\n" * 100_000))["bench"]
    assert len(told) == 1
    assert told[0].endswith("and 100000")


def test_ends_of_lines_alone_are_told() -> None:
    text = template().replace("\n", "\r\n")
    assert _found(_meta(bench_toml=text))["bench"] == ("differs in the ends of its lines only",)


def test_physics_that_no_file_says_are_told_unless_we_chose_them() -> None:
    again = _meta(physics={"seed": 2, "encoder": {"eccentricity_phase_deg": 3.0}, "gyro": {"U0_v": 0.1}})
    assert _found(again)["bench"] == (
        "physics.encoder.eccentricity_phase_deg was not there, is 3.0",
        "physics.gyro.U0_v was not there, is 0.1",
        "physics.seed was 1, is 2",
    )
    assert _found(again, CHOSEN_HERE)["bench"] == ("physics.gyro.U0_v was not there, is 0.1",)


def test_physics_that_the_file_says_are_in_the_diff_alone() -> None:
    text = template().replace("seed = 1\n", "seed = 1\n[physics.gyro]\nU0_v = 0.1\n")
    told = _found(_meta(bench_toml=text, physics={"seed": 1, "gyro": {"U0_v": 0.1}}))["bench"]
    assert "+U0_v = 0.1" in told
    assert not any(line.startswith("physics") for line in told)


def test_nested_tables_become_dotted_names() -> None:
    assert flat({"a": {"b": 1, "c": [{"d": 2}, {"d": 3}]}, "e": [4]}) == {
        "a.b": 1,
        "a.c.0.d": 2,
        "a.c.1.d": 3,
        "e": [4],
    }


def test_a_long_value_is_cut() -> None:
    (told,) = changes("", {"a": "x" * 10_000}, {})
    assert len(told) < 300
