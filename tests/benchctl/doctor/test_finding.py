import pytest

from benchctl.doctor.finding import Finding, bad, blamed, exit_status, look, ok, summary

FINE = ok("machine", "Python", "3.11")
WARNED = look("ports", "speed", "7 baud", "was 1200 meant?")
SILENT = bad("chamber", "answer", "silent", "switch it on")
NO_FOLDER = bad("results", "folder", "may not be written to", "name another one", unusable=True)


@pytest.mark.parametrize(
    ("findings", "status"),
    [([FINE, WARNED], 0), ([FINE, SILENT], 3), ([NO_FOLDER], 2), ([SILENT, NO_FOLDER], 2), ([], 0)],
)
def test_the_exit_status_is_that_of_the_worst(findings: list[Finding], status: int) -> None:
    assert exit_status(findings) == status


def test_the_summary_says_how_many_are_bad_and_what_to_do_first() -> None:
    assert summary([FINE]) == "nothing is bad"
    assert summary([FINE, WARNED]) == "nothing is bad; 1 to look at before a long campaign"
    assert summary([FINE, SILENT]) == "1 of 2 findings is bad; first chamber, answer: switch it on"
    assert summary([SILENT, NO_FOLDER]) == "2 of 2 findings are bad; first results, folder: name another one"
    assert blamed([SILENT, SILENT, NO_FOLDER, FINE]) == "3 of 4 findings are bad: chamber, results"
