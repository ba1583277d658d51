"""The table `[notify]` of bench.toml: what is taken, and that its secrets show nowhere."""

from __future__ import annotations

import tomllib

import pytest

from benchctl.bench import Bench, bench_of_text, template
from benchctl.campaign.opened import bench_toml_at
from benchctl.notifications import Recipient
from benchctl_instruments.errors import LinkError, UsageError
from tests.benchctl.receiver import receiving

pytestmark = pytest.mark.filterwarnings("ignore:'imghdr':DeprecationWarning")  # apprise imports it

SECRET = "tgram://123456789:s3cret_token/4711/"


def _bench(lines: str) -> Bench:
    return bench_of_text(f"{template()}\n{lines}\n", "bench.toml")


@pytest.mark.parametrize(
    "lines",
    [
        f'[notify]\nurls = ["{SECRET}"]',
        f"[notify]\nurls = [\n  \"env:CHAT\",\n  '{SECRET}', # the chat\n]",
        f'[notify]\nurls = ["env:CHAT"]\n# urls = ["{SECRET}", "env:CHAT"]\n# {SECRET}',
        f'[notify]\nurls = ["{SECRET}l0ng", "{SECRET}"]',
    ],
)
def test_the_text_that_recordings_store_has_the_same_lines_without_the_secrets(lines: str) -> None:
    bench = _bench(lines)
    assert not any(word in f"{bench.text} {bench!r}" for word in ("s3cret", "4711", "123456789", "l0ng"))
    assert "tgram://…" in bench.text
    assert bench.text.count("\n") == f"{template()}\n{lines}\n".count("\n")
    assert tomllib.loads(bench.text)["chamber"] == tomllib.loads(template())["chamber"]
    assert bench_of_text(bench.text, "bench.toml").notify is not None


def test_the_bench_that_sim_writes_has_no_recipients() -> None:
    bench = _bench(f'[notify]\nurls = ["{SECRET}"]')
    assert "tgram" not in bench_toml_at(bench, dict.fromkeys(bench.entries, "tcp://127.0.0.1:1"), 1.0)


def test_without_secrets_the_text_is_stored_as_it_is() -> None:
    lines = '[notify]\nurls = ["env:CHAT"]\n# [chamber] address = "serial:///dev/ttyUSB0?baud=19200"'
    assert _bench(lines).text == f"{template()}\n{lines}\n"


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        (f'[notify]\nurls = "{SECRET}"', "notify: urls: expected a list of texts"),
        (f'[notify]\nurls = ["{SECRET}", "s3cret"]', "number 2 is neither"),
        (f'[notify]\nurls = ["{SECRET}", ["s3cret"]]', "number 2 is neither"),
        (f'[notify]\nurl = ["{SECRET}"]', "there is no such field: did you mean urls"),
        (f'[notify]\nurls = ["{SECRET}"]\non = ["dnoe"]', "notify.on.0: expected 'done'"),
        ("[notify]\nurls = []", "notify.urls: expected at least 1 item"),
        ('[notify]\nurls = ["tgram://s3cret\\u005Ftoken"]', "tgram://… is written with escapes"),
    ],
)
def test_a_wrong_table_is_refused_in_a_line_that_does_not_show_it(lines: str, says: str) -> None:
    with pytest.raises(UsageError, match=r"^bench.toml, line \d+: ") as refused:
        _bench(lines)
    assert says in str(refused.value)
    assert "s3cret" not in str(refused.value)
    number = int(str(refused.value).partition("line ")[2].partition(":")[0])
    assert number > template().count("\n")


def test_a_list_of_tables_is_refused_without_being_shown() -> None:
    with pytest.raises(UsageError, match=r"notify: expected one table, \[notify\]$"):
        _bench(f'[[notify]]\nurls = ["{SECRET}"]')


def test_a_url_may_stand_in_an_environment_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match="needs the environment variable CHAT, which is not set"):
        Recipient("env:CHAT")
    with receiving() as (port, received):
        monkeypatch.setenv("CHAT", f"json://127.0.0.1:{port}/")
        recipient = Recipient("env:CHAT")
        recipient.send("title", "°C")
    assert recipient.shown == "env:CHAT"
    assert received == [("title", "°C")]


def test_what_apprise_says_of_a_url_is_passed_on_without_any_part_of_it(capfd: pytest.CaptureFixture[str]) -> None:
    with receiving(403) as (port, _), pytest.raises(LinkError) as refused:
        Recipient(f"json://user:p%40ss@127.0.0.1:{port}/s3cret").send("title", "text")
    assert str(refused.value).startswith("no message to json://…: ")
    assert "error=403" in str(refused.value)
    for url in (f"nope://{SECRET}", "tgram://s3cret"):
        with pytest.raises(UsageError, match="is no URL that apprise can use: ") as unknown:
            Recipient(url)
        assert "s3cret" not in str(unknown.value)
    assert capfd.readouterr() == ("", "")
