"""The API as a notebook uses it: its own examples, and what becomes of input that cannot be used."""

import datetime
import doctest
import os
import shutil
import signal
import threading
from pathlib import Path

import numpy as np
import pytest

from benchctl import api
from benchctl.plan import Soak, Static, procedure
from benchctl.recordings.importing import import_recording
from benchctl.recordings.verify import verify

EXAMPLES = [test for test in doctest.DocTestFinder().find(api) if test.examples]
SWEEP = {"soak_s": 600, "rates": 4, "run_s": 10, "zero_s": 10}
RATES_DPS = np.arange(-200.0, 201.0, 12.5)


@procedure()
def rest(at_c: float = 20.0, seconds: float = 5.0, repeats: int = 1, levels_c: tuple[float, ...] = (20.0,)):
    """The output at rest."""
    for celsius in (at_c, *levels_c[1:]):
        yield Soak(setpoint_c=celsius, hold_s=60.0)
    for _ in range(repeats):
        yield Static(duration_s=seconds)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a sweep, a campaign that was stopped, limits, and a table of points."""
    folder = tmp_path_factory.mktemp("api")
    api.run(api.plan("rate_sweep", **SWEEP), out=folder / "sweep", seed=7, wires=False)
    short = api.plan("static", soak_s=60, duration_s=10)
    api.run(short, out=folder / "stopped", progress=_stop, check=False)
    (folder / "lab").mkdir()
    shutil.copy("benchctl/metrology/limits.toml", folder / "lab" / "limits.toml")
    _tabulate(folder)
    return folder


def _stop(moment: api.Moment) -> None:
    if moment.doing == "recording":
        os.kill(os.getpid(), signal.SIGINT)


def _tabulate(folder: Path) -> None:
    """Static points of an interferometer, whose sine a straight line misses."""
    S = 0.0045
    volts = 0.01 + 0.05 / S * np.sin(S * RATES_DPS) + 0.008 * np.random.default_rng(1).standard_normal(RATES_DPS.size)
    rows = [f"{rate:g},{value:.6f}" for rate, value in zip(RATES_DPS, volts, strict=True)]
    (folder / "points.csv").write_text("\n".join(["rate_dps,gyro_v_mean", *rows]) + "\n", encoding="utf-8")
    import_recording(folder / "points.csv", None, folder / "points.h5")


@pytest.fixture
def here(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it, as the present folder."""
    shutil.copytree(place, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "here"


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
def test_every_example_of_the_api_runs_as_it_stands(example: doctest.DocTest) -> None:
    if example.name == "benchctl.api":
        shutil.rmtree("sweep")  # makes its own
    said: list[str] = []
    result = doctest.DocTestRunner().run(example, out=said.append)
    assert result.attempted > 2
    assert result.failed == 0, "".join(said)


def test_every_function_has_an_example() -> None:
    exampled = {test.name.rpartition(".")[2] for test in EXAMPLES}
    assert {"plan", "run", "resume", "simulate", "fit", "apply", "diagnose", "accept", "allan"} <= exampled


def test_parameters_are_python_s_own_or_numpy_s_and_are_what_a_command_line_would_make_of_them() -> None:
    plan = api.plan(rest, at_c=np.float64(25.5), repeats=np.int64(2), levels_c=np.array([20.0, 30.0]))
    assert plan.parameters == {"at_c": 25.5, "seconds": 5.0, "repeats": 2, "levels_c": (20.0, 30.0)}
    assert [step.kind for step in plan.steps] == ["soak", "soak", "static", "static"]
    assert api.plan(rest, levels_c=[20.0, 30.0]).steps == api.plan(rest, levels_c=(20, 30)).steps


def test_a_plan_of_a_file_is_that_of_the_procedure_in_it(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(
        "from benchctl.plan import Static, procedure\n\n\n@procedure()\ndef mine(s: float = 1.0):\n"
        "    yield Static(duration_s=s)\n",
        encoding="utf-8",
    )
    assert api.plan(path, s=3).steps == (Static(duration_s=3.0),)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"at": 20}, "did you mean at_c"),
        ({"repeats": 1.5}, "expected an integer, got '1.5'"),
        ({"at_c": float("nan")}, "parameter at_c: expected .*'nan'"),
        ({"seconds": None}, "parameter seconds: expected .*'None'"),
    ],
)
def test_a_parameter_that_cannot_be_is_told_in_a_line(given: dict[str, object], says: str) -> None:
    with pytest.raises(api.UsageError, match=says) as caught:
        api.plan(rest, **given)
    assert "\n" not in str(caught.value)


def test_a_run_tells_how_it_goes_and_leaves_a_sealed_campaign(tmp_path: Path) -> None:
    moments: list[api.Moment] = []
    outcome = api.run(api.plan(rest), out=tmp_path / "c", progress=moments.append, wires=False)
    assert outcome.status == "complete"
    assert outcome.error is None
    assert [moment.index for moment in moments] == sorted(moment.index for moment in moments)
    assert moments
    assert verify(outcome.campaign) == []
    with api.open(outcome.recording) as recording:
        assert [info.kind for info in recording.infos] == ["soak", "static"]


def test_the_same_seed_gives_the_same_samples_and_another_others(tmp_path: Path) -> None:
    volts = []
    for name, seed in (("a", 5), ("b", 5), ("c", 6)):
        outcome = api.run(rest, out=tmp_path / name, seed=seed, wires=False)
        with api.open(outcome.campaign) as recording:
            volts.append(recording.step(2)["gyro_v"])
    assert np.array_equal(volts[0], volts[1])
    assert not np.array_equal(volts[0], volts[2])


def test_what_ends_a_run_early_is_raised_with_a_note_where_its_recording_is_or_told_by_the_outcome(
    tmp_path: Path,
) -> None:
    too_warm = api.load_bench("simulated").model_copy(
        update={"interlocks": api.load_bench(_with_interlock(tmp_path)).interlocks}
    )
    with pytest.raises(api.SafetyError, match="air_c") as caught:
        api.run(rest, too_warm, out=tmp_path / "raised", wires=False)
    assert str(tmp_path / "raised") in caught.value.__notes__[0]
    outcome = api.run(rest, too_warm, out=tmp_path / "told", wires=False, check=False)
    assert outcome.status == "aborted"
    assert isinstance(outcome.error, api.SafetyError)
    assert outcome.safe.confirmed


def _with_interlock(folder: Path) -> str:
    path = folder / "bench.toml"
    text = Path("benchctl/bench.toml").read_text(encoding="utf-8")
    path.write_text(text + '\n[[interlocks]]\nquantity = "air_c"\nbelow = 22.0\n', encoding="utf-8")
    return str(path)


def test_ctrl_c_brings_a_run_to_its_end_and_is_heard_again_afterwards(tmp_path: Path) -> None:
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(api.BenchError, match=r"stopped by Ctrl-C") as caught:
        api.run(api.plan(rest, seconds=500), out=tmp_path / "c", progress=_stop, wires=False)
    assert signal.getsignal(signal.SIGINT) is before
    assert str(tmp_path / "c" / "recording.h5") in caught.value.__notes__[0]
    with api.open(tmp_path / "c") as recording:
        assert recording.meta.status == "interrupted"


def test_a_certificate_that_has_expired_is_a_warning(tmp_path: Path) -> None:
    bench = api.load_bench("simulated")
    table = bench.rate_table.model_copy(update={"calibrated_until": datetime.date(2020, 1, 31)})
    with pytest.warns(UserWarning, match="2020-01-31") as caught:
        api.run(rest, bench.model_copy(update={"rate_table": table}), out=tmp_path / "c", wires=False)
    assert caught[0].filename == __file__


def test_it_works_outside_the_main_thread(tmp_path: Path) -> None:
    outcomes: list[api.Outcome] = []
    thread = threading.Thread(target=lambda: outcomes.append(api.run(rest, out=tmp_path / "c", wires=False)))
    thread.start()
    thread.join()
    assert [outcome.status for outcome in outcomes] == ["complete"]


@pytest.mark.slow
def test_a_fit_writes_nothing_unless_a_folder_is_named_and_then_the_folder_stays_sealed(here: Path) -> None:
    before = sorted(here.rglob("*"))
    with api.open("sweep") as recording:
        silent = api.fit(recording)
    assert silent.files == {}
    assert sorted(here.rglob("*")) == before
    written = api.fit([here / "sweep"], out="sweep")
    assert {path.name for path in written.files.values()} == {"coefficients.json", "report.html"}
    assert verify(here / "sweep") == []
    assert written.coefficients["schema"] == "benchctl-coefficients/1"
    assert written.coefficients["K0_v_per_dps"] == written.K0_v_per_dps == silent.K0_v_per_dps
    assert str(written).startswith("error on runs kept aside: raw")


def test_a_diagnosis_writes_its_report_where_a_folder_is_named(here: Path) -> None:
    found = api.diagnose(here / "points.h5", out="found")
    assert found.files["report"] == Path("found/diagnosis.html")
    assert found.files["model"] == Path("found/model.toml")
    assert set(found.files.values()) == {path.relative_to(here) for path in (here / "found").iterdir()}
    assert found.findings[0].says in str(found)
    assert found.diagnosis.as_json()["verdict"] == found.verdict == "missing-physics"


@pytest.mark.usefixtures("here")
@pytest.mark.slow
def test_an_acceptance_writes_its_report_where_a_folder_is_named() -> None:
    accepted = api.accept("sweep", "lab/limits.toml", out="accepted", language="ru")
    assert set(accepted.files) == {"report", "pdf", "junit", "json"}
    assert all(path.is_file() for path in accepted.files.values())
    assert accepted.verdict == "INCONCLUSIVE"  # a sweep does not hold every test


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: api.plan("two_stages"), "did you mean two_stage"),
        (lambda: api.run(rest, "nowhere.toml"), "nowhere.toml"),
        (lambda: api.run(rest, seed=-1), "seed = -1: expected 0 or more"),
        (lambda: api.resume("nowhere", rest), "nowhere"),
        (lambda: api.resume("stopped", rest), "procedure was static, is rest"),
        (lambda: api.simulate(rest, "points.h5"), "points.h5: is there already"),
        (lambda: api.open("nowhere.h5"), "nowhere.h5"),
        (lambda: api.fit([]), "nothing was fitted: expected a recording"),
        (lambda: api.fit("sweep", out="lab/limits.toml"), "lab/limits.toml"),
        (lambda: api.apply("sweep", "nowhere.json", "points.h5"), "points.h5: is there already"),
        (lambda: api.allan("nowhere.h5"), "nowhere.h5"),
        (lambda: api.diagnose("sweep", model="nowhere.toml"), "nowhere.toml"),
        (lambda: api.accept("sweep", "nowhere.toml"), "nowhere.toml"),
        (lambda: api.accept("sweep", "lab/limits.toml", language="de"), "expected en or ru"),
    ],
)
def test_what_cannot_be_used_is_told_in_a_line(call: object, says: str) -> None:
    assert callable(call)
    with pytest.raises(api.UsageError, match=says) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_a_recording_that_was_changed_is_neither_fitted_nor_diagnosed_nor_accepted(here: Path) -> None:
    import h5py

    with h5py.File(here / "sweep" / "recording.h5", "r+") as file:
        file["steps/0003/gyro_v"][10] += 0.001
    for call in (api.fit, api.diagnose, lambda one: api.accept(one, "lab/limits.toml")):
        with pytest.raises(api.UsageError, match="changed since it was written"):
            call("sweep")
