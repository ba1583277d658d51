import inspect
from pathlib import Path

import pytest

from benchctl_instruments.catalog import Kind, driver, find_profile, models, twin
from benchctl_instruments.errors import UsageError
from tests.instruments.chambers.lab_controllers import BRAND

OURS: dict[Kind, tuple[str, ...]] = {
    "rate_table": ("acutrol3000", "aerotech_ensemble", "manual", "newport_esp301"),
    "chamber": (
        "binder_mb1",
        "binder_mb2",
        "csz_ezt430i",
        "espec_p300",
        "eurotherm_2400",
        "eurotherm_3500",
        "thermotron_3800",
        "thermotron_8800",
        "watlow_f4",
        "watlow_f4t",
        "watlow_f4t_scpi",
        "weiss_ascii2",
        "weiss_simserv",
    ),
    "digitizer": ("keithley_daq6510", "keysight_34970a", "keysight_daq970a", "labjack_t7", "ni_daqmx"),
    "gyro": ("kvh_dsp1760", "sensonor_stim300"),
}


@pytest.mark.parametrize("kind", OURS)
def test_every_model_of_ours_has_a_driver_and_a_simulated_twin(kind: Kind) -> None:
    assert models(kind) == OURS[kind]
    for model in models(kind):
        assert isinstance(driver(kind, model), type)
        assert isinstance(twin(kind, model), type)


def test_every_driver_says_that_it_was_not_tried_on_hardware() -> None:
    for kind in ("rate_table", "chamber", "digitizer", "gyro"):
        for model in models(kind):
            found = driver(kind, model)
            text = f"{inspect.getmodule(found).__doc__} {found.__doc__}"
            assert "not tried on hardware" in " ".join(text.split()).lower()


@pytest.mark.parametrize(
    ("model", "says"),
    [
        ("watlow_f5", "did you mean watlow_f4"),
        ("quantities", "there is no 'quantities'"),
        ("../etc", "there are binder_mb1, binder_mb2, csz_ezt430i, .*watlow_f4t"),
        ("", "there are binder_mb1, binder_mb2, csz_ezt430i, .*watlow_f4t"),
    ],
)
def test_a_model_that_is_none_is_named_with_those_there_are(model: str, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        driver("chamber", model)


def test_a_profile_that_is_not_there_is_told_with_those_beside_it(tmp_path: Path) -> None:
    (tmp_path / "brand_x.toml").write_text(BRAND, encoding="utf-8")
    for find in (driver, twin):
        with pytest.raises(
            UsageError, match=r"chamber.model: there is no profile '.*brand-x.toml': did you mean brand_x"
        ):
            find("chamber", f"{tmp_path}/brand-x.toml")
        with pytest.raises(UsageError, match=r"there is no profile '.*zz.toml': that folder has brand_x.toml"):
            find("chamber", f"{tmp_path}/zz.toml")
        with pytest.raises(UsageError, match=r"nowhere/zz\.toml': there is no such folder"):
            find("chamber", f"{tmp_path}/nowhere/zz.toml")


def test_a_path_is_looked_up_from_the_present_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "brand_x.toml").write_text(BRAND, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert callable(driver("chamber", "brand_x.toml"))
    assert callable(twin("chamber", "brand_x.toml"))


def test_a_profile_whose_text_is_given_needs_no_file() -> None:
    for find in (driver, twin):
        assert callable(find("chamber", "/nowhere/brand_x.toml", BRAND))
        with pytest.raises(UsageError, match=r"chamber profile /nowhere/brand_x.toml, air: this field is needed"):
            find("chamber", "/nowhere/brand_x.toml", BRAND.replace("[air]", "[aire]"))


def test_a_path_begins_in_the_folder_that_is_named_or_at_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a").mkdir()
    lab, home = tmp_path / "a" / "lab.toml", tmp_path / "home.toml"
    lab.write_text("lab", encoding="utf-8")
    home.write_text("home", encoding="utf-8")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert find_profile("lab.toml", Path("a")) == (lab, "lab")
    assert find_profile("~/home.toml", Path("a")) == (home, "home")
    assert find_profile(str(home), Path("a")) == (home, "home")


def test_a_home_that_nobody_has_is_told() -> None:
    with pytest.raises(UsageError, match=r"chamber\.model: '~nobody-here/lab\.toml': there is no such home folder"):
        find_profile("~nobody-here/lab.toml", Path())


def test_a_profile_that_is_wrong_is_named_with_its_field(tmp_path: Path) -> None:
    (tmp_path / "brand_x.toml").write_text(BRAND.replace("[air]", "[aire]"), encoding="utf-8")
    for find in (driver, twin):
        with pytest.raises(UsageError, match=r"chamber profile .*brand_x.toml, air: this field is needed"):
            find("chamber", f"{tmp_path}/brand_x.toml")


@pytest.mark.parametrize("name", ["long" * 100 + ".toml", "nul\0.toml", ".toml", "~nobody-here/a.toml"])
def test_a_name_that_no_profile_can_have_is_told(name: str) -> None:
    with pytest.raises(UsageError):
        driver("chamber", name)


def test_only_chambers_have_profiles(tmp_path: Path) -> None:
    with pytest.raises(
        UsageError, match=r"rate_table\.model: .* is a profile, and only chambers have such; there are acu"
    ):
        driver("rate_table", f"{tmp_path}/brand_x.toml")
