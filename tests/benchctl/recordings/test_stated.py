import json
from dataclasses import fields
from datetime import date
from pathlib import Path

import pytest

from benchctl.bench import load_bench, template
from benchctl.certificates import Expired
from benchctl.recordings.model import BenchFacts, Meta
from benchctl.recordings.stated import ASSUMED, Stated, StatedUncertainties, expired_of, stated, stated_of
from tests.benchctl.recordings import made

CERTIFIED = (
    template().replace("# latitude_uncertainty_deg", "latitude_uncertainty_deg")
    + """
[rate_table.certificate]
number = "LNE 2026-123"
encoder_arcsec = 2.0
tilt_deg = 0.02
mounting_deg = 0.1
[chamber.certificate]
k = 3
air_c = 0.3
[digitizer.certificate]
number = "D-7"
gain_ppm = 40.0
offset_v = 2e-5
clock_ppm = 0.0
"""
)
BY_TABLE = "certificate LNE 2026-123, k = 2"


def _figures(found: StatedUncertainties) -> dict[str, Stated]:
    return {item.name: getattr(found, item.name) for item in fields(found)}


def _recorded(bench_toml: str) -> Meta:
    return made.meta(provenance={"bench_toml": bench_toml})


def test_an_expanded_figure_becomes_a_standard_uncertainty_by_its_coverage_factor() -> None:
    found = stated_of(_recorded(CERTIFIED))
    assert _figures(found) == {
        "encoder_arcsec": Stated(standard=1.0, says=BY_TABLE),
        "tilt_deg": Stated(standard=0.01, says=BY_TABLE),
        "mounting_deg": Stated(standard=0.05, says=BY_TABLE),
        "gain_ppm": Stated(standard=20.0, says="certificate D-7, k = 2"),
        "offset_v": Stated(standard=1e-5, says="certificate D-7, k = 2"),
        "clock_ppm": Stated(standard=0.0, says="certificate D-7, k = 2"),
        "thermometer_c": Stated(standard=0.1, says="assumed"),
        "air_c": Stated(standard=pytest.approx(0.1), says="certificate, k = 3"),
        "latitude_deg": Stated(standard=0.025, says="stated for the site, k = 2"),
    }


def test_a_bench_says_the_same_as_a_recording_made_on_it(tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(CERTIFIED, encoding="utf-8")
    assert stated(load_bench(str(tmp_path / "bench.toml"))) == stated_of(_recorded(CERTIFIED))


def test_what_nobody_states_is_assumed_and_says_so() -> None:
    figures = _figures(stated(load_bench("simulated")))
    for name, standard in ASSUMED.items():
        assert figures.pop(name) == Stated(standard=standard, says="assumed")
    assert figures == {
        "encoder_arcsec": Stated(standard=pytest.approx(20.0 / 3**0.5), says="±20″ stated, uniform"),
        "offset_v": Stated(standard=pytest.approx(20.0 / 65536 / 12**0.5), says="one step of the converter, uniform"),
    }


def test_a_foreign_recording_has_the_facts_that_it_brings_and_no_certificate() -> None:
    found = stated_of(made.meta())
    assert found.encoder_arcsec == Stated(standard=0.0, says="not known, taken as none")
    assert found.offset_v.standard == pytest.approx(20.0 / 65536 / 12**0.5)
    assert found.gain_ppm.says == "assumed"
    blind = stated_of(made.meta(bench=BenchFacts(sample_rate_hz=100.0, encoder_accuracy_arcsec=3.0)))
    assert blind.offset_v == Stated(standard=0.0, says="not known, taken as none")
    assert blind.encoder_arcsec.standard == pytest.approx(3.0**0.5)


@pytest.mark.parametrize("text", ["name = 'of another version'", "no toml", "a = " + "[" * 100_000])
def test_a_bench_toml_that_cannot_be_read_certifies_nothing_and_that_is_said(text: str) -> None:
    found = stated_of(_recorded(text))
    assert found.tilt_deg == Stated(standard=0.1, says="assumed: the recording's bench.toml cannot be read")


def _started(day: str, **instruments: object) -> Meta:
    return made.meta(provenance={"started_utc": day, "instruments": json.dumps(instruments)})


TABLE = {"manufacturer": "Acutronic", "model": "ACUTROL3000", "serial": "S-1", "bench_serial": "AC-1234"}


def test_a_certificate_is_judged_on_the_day_the_recording_was_started() -> None:
    told = {"rate_table": {**TABLE, "calibrated_until": "2026-11-20"}}
    (found,) = expired_of(_started("2026-11-21T00:00:01+00:00", **told))
    assert found == Expired(
        role="rate_table",
        model="ACUTROL3000",
        serial="AC-1234",
        calibrated_until=date(2026, 11, 20),
        started=date(2026, 11, 21),
    )
    assert expired_of(_started("2026-11-20T23:59:59+00:00", **told)) == ()


@pytest.mark.parametrize(
    "meta",
    [
        made.meta(),
        _started("yesterday", rate_table={**TABLE, "calibrated_until": "2020-01-01"}),
        _started("2026-11-21", rate_table={**TABLE, "calibrated_until": ""}),
        _started("2026-11-21", rate_table={**TABLE, "calibrated_until": "soon"}, chamber=["2020-01-01"]),
        made.meta(provenance={"started_utc": "2026-11-21", "instruments": "[" * 1000}),
        made.meta(provenance={"started_utc": "2026-11-21", "instruments": "[]"}),
    ],
)
def test_where_no_day_is_known_none_has_expired(meta: Meta) -> None:
    assert expired_of(meta) == ()
