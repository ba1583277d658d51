import sys

from benchctl.doctor.machine.software import missing, satisfies, software_findings

LINES = [
    "pydantic<3,>=2.7",
    "pymodbus<1,>=0.5",
    "no-such-package>=1",
    'fastapi>=0.115; extra == "dashboard"',
    'benchctl[dashboard]; extra == "test"',
    'another-missing-one; extra == "test"',
]


def test_a_package_that_is_absent_or_of_a_wrong_version_is_named() -> None:
    from importlib.metadata import version

    assert missing(LINES, "") == [
        f"pymodbus {version('pymodbus')} is there, <1,>=0.5 is wanted",
        "no-such-package is not there",
    ]
    assert missing(LINES, "test") == ["another-missing-one is not there"]


def test_versions_are_compared_number_by_number() -> None:
    assert satisfies("3.10", ">=3.9")
    assert satisfies("2.0", "==2")
    assert not satisfies("2.0.1", "<=2.0")
    assert not satisfies("1.5", "!=1.5")
    assert satisfies("1.6rc1", ">1.5")
    assert satisfies("0.1", "")


def test_this_installation_is_whole() -> None:
    found = {finding.what: finding for finding in software_findings()}
    assert {"Python", "benchctl", "packages"} <= found.keys()
    assert {finding.verdict for finding in found.values()} == {"ok"}
    assert sys.executable in found["Python"].says
