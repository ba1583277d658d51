from base64 import b64decode
from pathlib import Path

import pytest

from benchctl.bench import Interlock, load_bench, template
from benchctl_instruments.errors import UsageError


def _written(folder: Path, old: str, new: str) -> str:
    assert old in template()
    path = folder / "bench.toml"
    path.write_text(template().replace(old, new), encoding="utf-8")
    return str(path)


def test_the_template_is_the_simulated_bench() -> None:
    bench = load_bench("simulated")
    assert bench.simulated
    assert bench.text == template()
    assert bench.digitizer.sample_rate_hz == 500.0


@pytest.mark.parametrize(
    ("old", "new", "line", "says"),
    [
        ("latitude_deg = 58.5", "lattitude_deg = 58.5", 44, "site.lattitude_deg: there is no such field"),
        ("simulated = true", "simulated = true\ntext = 'a'", 9, "text: there is no such field"),
        ("range_dps = 175.0", "range_dps = 'fast'", 14, "unit.range_dps: expected a number"),
        ("ramp_c_per_min = 2.0", "# gone", 17, "limits.ramp_c_per_min: this field is needed and is not there"),
        (
            "rate_dps = 300.0",
            "rate_dsp = 300.0",
            18,
            "limits.rate_dsp: there is no such field: did you mean rate_dps?",
        ),
        (
            "rate_dps = 300.0\nacceleration_dps2 = 1500.0",
            "rate_dsp = 300.0",
            18,
            "rate_dsp: there is no such field: did you mean rate_dps?; needed and not there: limits.acceleration_dps2",
        ),
        ("seed = 1", "seed = -1", 127, "[physics] seed is -1; give an integer, 0 or more"),
        ("coldest_c = -55.0", "coldest_c = 90.0", 20, "coldest_c (90) must be below hottest_c (85)"),
        ("chamber_c = 23.0", "chamber_c = 99.0", 30, "safe.chamber_c (99) lies outside"),
        (
            "simulated = true",
            "simulated = false",
            47,
            "rate_table.address, chamber.address, digitizer.address must be given",
        ),
        ("encoder_sign = 1 ", "encoder_sign = 2 ", 69, "digitizer.encoder_sign: expected 1 or -1, got 2"),
        ("thermistor_c_per_v = 20.0", "thermistor_c_per_v = 0.0", 71, "thermistor_c_per_v: expected another number"),
        ("rate_dps = 300.0", "rate_dps = nan", 18, "limits.rate_dps: expected"),
        ("hang_s = 60.0", "hang_s = 10.0", 31, "safe.hang_s (10) must be longer than limits.silence_s (10)"),
        (
            "[site]",
            "[[interlocks]]\nquantity = 'air_k'\nabove = 1\n[site]",
            44,
            "expected 'rate_dps', 'acceleration_dps2'",
        ),
        ("[site]", "[[interlocks]]\nquantity = 'air_c'\n[site]", 43, "air_c: expected above, below or both"),
    ],
)
def test_a_wrong_field_is_named_with_its_file_and_line(
    tmp_path: Path, old: str, new: str, line: int, says: str
) -> None:
    path = _written(tmp_path, old, new)
    with pytest.raises(UsageError) as caught:
        load_bench(path)
    message = str(caught.value)
    assert message.startswith(f"{path}, line {line}: ")
    assert says in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            'name = "a"\n[unit]\nserail = "x"\n[limits]\nrate_dsp = 1.0\nsilence_s = -1\n',
            "line 3: unit.serail: there is no such field: did you mean serial?; needed and not there: unit.range_dps, "
            "limits.acceleration_dps2, limits.coldest_c, limits.hottest_c, limits.ramp_c_per_min, rate_table, chamber, "
            "digitizer (and 2 more)",
        ),
        (
            "",
            "line 1: name, unit, limits, rate_table, chamber, digitizer: these fields are needed and are not there",
        ),
        (
            template().replace("rate_dps = 300.0", "").replace("coldest_c = -55.0", "") + "[gyro]\n",
            "line 17: limits.rate_dps, limits.coldest_c, gyro.model: these fields are needed and are not there",
        ),
    ],
)
def test_all_missing_fields_are_named_at_once_and_no_misspelt_one_among_them(
    tmp_path: Path, text: str, says: str
) -> None:
    (tmp_path / "bench.toml").write_text(text)
    with pytest.raises(UsageError) as caught:
        load_bench(str(tmp_path / "bench.toml"))
    assert str(caught.value) == f"{tmp_path}/bench.toml, {says}"


@pytest.mark.parametrize(
    ("table", "says"),
    [
        (
            '[[faults]]\non = "chamber"\nkind = "late"\nevrey = 3\n',
            "faults.0.late.evrey: there is no such field: did you ",
        ),
        (
            '[[interlocks]]\nquantity = "air_c"\nabve = 3\n',
            "interlocks.0.abve: there is no such field: did you mean above?",
        ),
        ('[gyro]\nmodel = "kvh_dsp1760"\nframe_rate = 3\n', "did you mean frame_rate_hz?"),
        ('[chamber.certificate]\nair = 3\nnumber = "1"\n', "did you mean air_c?"),
        ("[limts]\n", "limts: there is no such field: did you mean limits?"),
        ("[gremlins]\n", "gremlins: there is no such field"),
    ],
)
def test_a_misspelt_key_of_any_table_gets_a_suggestion(tmp_path: Path, table: str, says: str) -> None:
    (tmp_path / "bench.toml").write_text(f"{template()}\n{table}")
    with pytest.raises(UsageError) as caught:
        load_bench(str(tmp_path / "bench.toml"))
    assert says in str(caught.value)


def test_a_file_that_is_not_toml_names_the_place(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text("name = \n")
    with pytest.raises(UsageError, match=r"not TOML: .*line 1"):
        load_bench(str(path))


@pytest.mark.parametrize(("content", "says"), [(None, "cannot be read"), (b"\xff\xfe", "expected UTF-8 text")])
def test_a_file_that_cannot_be_read_says_why(tmp_path: Path, content: bytes | None, says: str) -> None:
    path = tmp_path / "bench.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UsageError, match=says):
        load_bench(str(path))


def test_a_folder_is_no_bench(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"expected a bench\.toml, this is a folder"):
        load_bench(str(tmp_path))


def test_a_seed_replaces_that_of_the_file() -> None:
    assert load_bench("simulated").with_seed(7).physics["seed"] == 7
    assert load_bench("simulated").with_seed(None).physics["seed"] == 1


def test_the_interlocks_of_a_bench_are_those_of_its_file_in_order(tmp_path: Path) -> None:
    tables = (
        "[[interlocks]]\nquantity = 'gyro_c'\nabove = 70.0\nhysteresis = 2\nfor_s = 30\naction = 'hold'\n"
        "give_up_s = 3600.0\n[[interlocks]]\nquantity = 'rate_dps'\nabove = 200\nbelow = -200\n[site]"
    )
    hold, stop = load_bench(_written(tmp_path, "[site]", tables)).interlocks
    assert hold == Interlock(quantity="gyro_c", above=70.0, hysteresis=2.0, for_s=30.0, action="hold", give_up_s=3600.0)
    assert stop == Interlock(quantity="rate_dps", above=200.0, below=-200.0)
    assert stop.action == "stop"


def test_the_example_of_an_interlock_in_the_template_can_be_used_as_it_stands(tmp_path: Path) -> None:
    begin = template().index("# [[interlocks]]")
    lines = template()[begin : template().index("[site]")].strip()
    path = _written(tmp_path, lines, lines.replace("# ", "", 1).replace("\n# ", "\n"))
    (interlock,) = load_bench(path).interlocks
    assert (interlock.quantity, interlock.action, interlock.give_up_s) == ("gyro_c", "hold", 3600.0)


def test_effects_of_a_bench_are_checked_when_it_is_read(tmp_path: Path) -> None:
    path = _written(tmp_path, "[physics]", "[effects.thermal_lag]\ntau_s = 312.0\n[physics]")
    assert load_bench(path).effects == {"thermal_lag": {"tau_s": 312.0}}
    path = _written(tmp_path, "[physics]", "[effects.thermal_lag]\ntau = 312.0\n[physics]")
    with pytest.raises(
        UsageError, match=r"bench\.toml, line 127: \[effects\.thermal_lag\] tau: no such field; there are tau_s$"
    ):
        load_bench(path)


def test_a_real_bench_plays_no_effects(tmp_path: Path) -> None:
    text = template().replace("simulated = true", "simulated = false")
    text = text.replace("# address", "address").replace('address = "serial', '# address = "serial')
    (tmp_path / "real.toml").write_text(text, encoding="utf-8")
    assert not load_bench(str(tmp_path / "real.toml")).simulated
    (tmp_path / "real.toml").write_text(f"{text}\n[effects.clock_drift]\nppm = 3.0\n", encoding="utf-8")
    with pytest.raises(UsageError, match=r"\[effects\] is played by simulated instruments only"):
        load_bench(str(tmp_path / "real.toml"))


PNG = b"\x89PNG\r\n\x1a\n and so on"


@pytest.mark.parametrize(
    ("logo", "says"),
    [
        (PNG, ""),
        (b"GIF89a", "laboratory.logo .*logo.png: expected a PNG file"),
        (None, "laboratory.logo .*logo.png: cannot be read: no such file"),
        (PNG + bytes(300_000), "laboratory.logo .*logo.png: is larger than 0.3 MB"),
    ],
)
def test_the_logo_of_the_laboratory_is_read_beside_the_bench(tmp_path: Path, logo: bytes | None, says: str) -> None:
    laboratory = '\n[laboratory]\nname = "Gyro laboratory"\nlogo = "logo.png"\n'
    (tmp_path / "bench.toml").write_text(template() + laboratory, encoding="utf-8")
    if logo is not None:
        (tmp_path / "logo.png").write_bytes(logo)
    if says:
        with pytest.raises(UsageError, match=says):
            load_bench(str(tmp_path / "bench.toml"))
    else:
        assert b64decode(load_bench(str(tmp_path / "bench.toml")).with_seed(3).logo) == PNG
