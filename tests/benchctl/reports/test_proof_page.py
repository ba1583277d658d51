"""The report on a proof."""

from pathlib import Path

from benchctl.proof.summary import summarize
from benchctl.proof.trial import Answer, Trial
from benchctl.reports.proof_page import lines, proof_page, write_proof_report
from tests.benchctl.proof.made import finding, said, trial, truth
from tests.benchctl.reports.page import Page

LAG = {"thermal_lag": {"tau_s": 300.0}}
TRIALS = [
    trial(0, truth("nothing"), said(verdict="consistent"), ("warm_up",)),
    trial(1, truth("single", LAG), said(finding("thermal_lag", tau_s=(310.0, 295.0, 315.0))), ("thermal_lag",)),
    trial(2, truth("single", LAG), said(finding("thermal_hysteresis"), where=("time",)), ()),
]


def test_the_page_holds_the_table_the_matrix_and_the_trials_that_were_not_right() -> None:
    page = Page(proof_page(summarize(4, TRIALS)))
    assert "Sealed trials of the diagnosis 3 trials, seed 4" in page.words
    assert "single effects 2 1 of 2 (50 %) 2 of 2 (100 %) 1 1 1 of 2 (50 %) 0" in page.words
    assert "2 single effects thermal_lag (tau_s = 300)" in page.words
    assert "missing-physics; thermal_hysteresis; unexplained along time" in page.words
    assert TRIALS[0].digest in page.words
    assert [name for name, _ in page.tags].count("figure") == 1


def test_the_same_trials_give_the_same_page() -> None:
    assert proof_page(summarize(4, TRIALS)) == proof_page(summarize(4, TRIALS[::-1]))


def test_where_all_is_right_the_page_says_so() -> None:
    assert "Trials that were not right None." in Page(proof_page(summarize(4, TRIALS[:2]))).words


def test_page_and_picture_are_written(tmp_path: Path) -> None:
    written = write_proof_report(tmp_path, summarize(4, TRIALS))
    assert written["report"].read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert written["picture"].read_bytes().startswith(b"\x89PNG")


def test_without_any_answer_there_is_a_page_and_no_picture(tmp_path: Path) -> None:
    silent = Trial(
        index=0, kind="single", digest="d", truth=truth("single", LAG).as_json(), rows=1, recorded_s=1.0,
        physics=Answer(score=None, error="no answer after 900 s"), generic=None,
    )  # fmt: skip
    written = write_proof_report(tmp_path, summarize(4, [silent]))
    assert list(written) == ["report"]
    assert "no answer after 900 s" in Page(written["report"].read_text(encoding="utf-8")).words


def test_the_terminal_gets_a_line_a_class_and_both_arms() -> None:
    told = list(lines(summarize(4, TRIALS)))
    assert told[0].split() == ["right", "verdict", "sparse", "regr."]
    assert told[2].split() == ["single", "effects", "1", "of", "2", "2", "of", "2", "1", "of", "2"]
    assert "diagnosis: named 1 of 2 (50 %) of what was drawn, 1 made up" in told
    assert "sparse regression: named 1 of 2 (50 %) of what was drawn, 1 made up" in told
    assert "  nothing missing, yet something named: 1 of 1 (100 %)" in told
    assert "  time for one answer: 12.0 s (median), at most 512 MiB" in told
