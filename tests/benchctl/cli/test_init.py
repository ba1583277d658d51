import json
import tomllib
from pathlib import Path

import jsonschema_rs
import pytest

from benchctl.bench import load_bench, template
from benchctl.cli.app import run_verb
from benchctl.metrology.limit_file import read_limits

FILES = {"bench.toml", "limits.toml", "acceptance.bench-test.toml", "bench.schema.json", "limits.schema.json"}


@pytest.fixture
def lab(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    folder = tmp_path / "lab"
    assert run_verb(["init", str(folder), "--json", str(tmp_path / "told.json")]) == 0
    assert f"wrote {folder / 'bench.toml'}: the bench is simulated" in capsys.readouterr().out
    return folder


def test_it_writes_a_bench_and_limits_with_their_schemas(lab: Path) -> None:
    assert {path.name for path in lab.iterdir()} == FILES
    told = json.loads((lab.parent / "told.json").read_text())
    assert told["schemas"] == [str(lab / "bench.schema.json"), str(lab / "limits.schema.json")]


def test_what_it_writes_is_read_again(lab: Path) -> None:
    assert load_bench(str(lab / "bench.toml")).simulated
    assert "scale_factor" in read_limits(lab / "limits.toml").limits


@pytest.mark.parametrize("name", ["bench", "limits"])
def test_the_first_line_names_the_schema_and_the_file_obeys_it(lab: Path, name: str) -> None:
    text = (lab / f"{name}.toml").read_text(encoding="utf-8")
    first, rest = text.split("\n", 1)
    word, _, schema = first.partition(" ")
    assert word == "#:schema"
    assert name != "bench" or rest == template()
    jsonschema_rs.validate(json.loads((lab / schema).read_text(encoding="utf-8")), tomllib.loads(text))


def test_a_schema_of_an_older_version_is_replaced_and_a_bench_never_is(tmp_path: Path) -> None:
    (tmp_path / "bench.schema.json").write_text("{}")
    assert run_verb(["init", str(tmp_path), "--quiet"]) == 0
    assert "properties" in json.loads((tmp_path / "bench.schema.json").read_text(encoding="utf-8"))
    (tmp_path / "limits.toml").unlink()
    (tmp_path / "bench.toml").write_text("mine")
    assert run_verb(["init", str(tmp_path), "--quiet"]) == 2
    assert (tmp_path / "bench.toml").read_text() == "mine"
    assert not (tmp_path / "limits.toml").exists()
