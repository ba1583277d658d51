from datetime import date
from pathlib import Path

import pytest

from benchctl.bench import Bench, load_bench, template
from benchctl.certificates import Certificate, Expired, expired
from benchctl_instruments.errors import UsageError

CERTIFIED = """
[rate_table.certificate]
number = "LNE 2026-123"
encoder_arcsec = 2.0
tilt_deg = 0.02
[chamber.certificate]
k = 3
air_c = 0.3
"""
TODAY = date(2026, 11, 21)


def bench_with(folder: Path, tables: str, text: str | None = None) -> str:
    path = folder / "bench.toml"
    path.write_text((text or template()) + tables, encoding="utf-8")
    return str(path)


def calibrated(folder: Path, **dates: str) -> Bench:
    """The simulated bench, its instruments calibrated until these days."""
    text = template()
    for role, day in dates.items():
        text = text.replace(f"[{role}]\n", f"[{role}]\ncalibrated_until = {day}\nserial = '{role[:2].upper()}-1'\n")
    return load_bench(bench_with(folder, "", text))


def test_a_certificate_states_its_number_its_factor_and_its_figures(tmp_path: Path) -> None:
    bench = load_bench(bench_with(tmp_path, CERTIFIED))
    table, chamber = bench.rate_table.certificate, bench.chamber.certificate
    assert table is not None
    assert (table.number, table.k, table.encoder_arcsec, table.mounting_deg) == ("LNE 2026-123", 2.0, 2.0, None)
    assert table.source == "certificate LNE 2026-123, k = 2"
    assert chamber is not None
    assert (chamber.k, chamber.air_c, chamber.source) == (3.0, 0.3, "certificate, k = 3")
    assert bench.digitizer.certificate is None


def test_the_certificates_of_the_template_can_be_used_as_they_stand(tmp_path: Path) -> None:
    begin = template().index("# [rate_table.certificate]")
    lines = template()[begin : template().index("# A digital gyro under test")].strip()
    bench = load_bench(bench_with(tmp_path, "\n" + lines.replace("# ", "", 1).replace("\n# ", "\n")))
    assert bench.rate_table.certificate is not None
    assert bench.digitizer.certificate is not None
    assert bench.digitizer.certificate.model_dump() == {
        "number": "D-2026-7", "k": 2.0, "gain_ppm": 40.0, "offset_v": 2e-5, "clock_ppm": 10.0, "thermometer_c": 0.1,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("tables", "says"),
    [
        (
            "[rate_table.certificate]\ntilt_deg = -0.1",
            "rate_table.certificate.tilt_deg: expected a number of at least 0",
        ),
        ("[rate_table.certificate]\nk = 0", "rate_table.certificate.k: expected a number above 0, got 0"),
        ("[rate_table.certificate]\nair_c = 0.3", "rate_table.certificate.air_c: there is no such field"),
        ("[chamber.certificate]\nair_c = nan", "chamber.certificate.air_c: expected"),
        ("[digitizer.certificate]\ngain_ppm = '40'\nclock = 1", "digitizer.certificate.clock: there is no such field"),
        ("[digitizer.certificate]\nnumber = 7", "digitizer.certificate.number: expected text, got 7"),
        ('[digitizer.certificate]\nnumber = "a\\nb"', "digitizer.certificate.number: expected a number as it is"),
    ],
)
def test_a_wrong_figure_is_named_with_its_file_and_line(tmp_path: Path, tables: str, says: str) -> None:
    path = bench_with(tmp_path, tables)
    with pytest.raises(UsageError) as caught:
        load_bench(path)
    line = len(template().splitlines()) + len(tables.splitlines())
    assert str(caught.value).startswith(f"{path}, line {line}: {says}")
    assert "\n" not in str(caught.value)


def test_the_uncertainty_of_the_latitude_cannot_be_negative(tmp_path: Path) -> None:
    text = template().replace("latitude_deg = 58.5 ", "latitude_uncertainty_deg = -1 ")
    with pytest.raises(UsageError, match=r"line 44: site\.latitude_uncertainty_deg: expected a number of at least"):
        load_bench(bench_with(tmp_path, "", text))


def test_a_certificate_holds_through_its_last_day(tmp_path: Path) -> None:
    bench = calibrated(tmp_path, rate_table="2026-11-20", chamber="2026-11-21", digitizer="2026-11-22")
    assert expired(bench.entries, TODAY) == (
        Expired(
            role="rate_table", model="acutrol3000", serial="RA-1", calibrated_until=date(2026, 11, 20), started=TODAY
        ),
    )
    assert expired(bench.entries, date(2026, 11, 20)) == ()


def test_one_that_ends_before_a_run_does_is_told_apart_from_one_that_has_ended(tmp_path: Path) -> None:
    bench = calibrated(tmp_path, rate_table="2026-11-20", chamber="2026-11-21", digitizer="2026-11-23")
    assert [each.message for each in expired(bench.entries, TODAY, until=date(2026, 11, 23))] == [
        "rate_table acutrol3000 RA-1: its certificate expired on 2026-11-20",
        "chamber watlow_f4t CH-1: its certificate expires on 2026-11-21, before the run's planned end",
    ]


def test_an_instrument_without_a_date_never_expires() -> None:
    assert expired(load_bench("simulated").entries, date(9999, 1, 1)) == ()


def test_a_certificate_without_a_number_says_so_by_having_none() -> None:
    assert Certificate().source == "certificate, k = 2"
