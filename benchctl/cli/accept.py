"""`benchctl accept`: judge the tests of a gyro by limits."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from benchctl.cli.output import JsonOption, QuietOption, RecordingArgument, out_option, result_of, toml_option

LanguageOption = Annotated[Literal["en", "ru"], typer.Option("--lang", help="Language of the report.")]


def accept(
    recording: RecordingArgument,
    limits: Annotated[Path, toml_option("--limits", "The limits, as TOML; `benchctl init` writes an example.")],
    out: Annotated[Path | None, out_option("For the report; default: in the campaign's folder.")] = None,
    lang: LanguageOption = "en",
    sign: Annotated[
        Path | None,
        typer.Option("--sign", metavar="KEY", help="Sign report and recording with this OpenSSH Ed25519 key."),
    ] = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Measure the gyro's characteristics from the recording, judge them by limits, and write the report.

    Each verdict is PASS, FAIL or INCONCLUSIVE, with expanded uncertainty (95.45 %) and guard band. Writes
    `acceptance.html`, `.pdf`, `.xml` (JUnit) and `.json`. Exit status 1 unless every test with a limit passes.

    `--sign` also writes `acceptance.signed.json`, which states what is signed, and its signature `.sig`. The comment of
    KEY.pub is the signer's name; benchctl prompts for the passphrase, or takes it from `BENCHCTL_PASSPHRASE`.

    Example: `benchctl accept results/20261120-180000_acceptance_SIM-0001 --limits lab/limits.toml`,
    `benchctl accept results/20261120-180000_acceptance_SIM-0001 --limits lab/limits.toml --sign ~/.ssh/id_ed25519`
    """
    from benchctl.app import accept as app
    from benchctl.cli.output import report_folder

    with result_of("accept", json_to, quiet) as result:
        key = app.signing_key(sign, _passphrase if sys.stdin.isatty() else None) if sign else None
        optional = json_to if key is None else None  # a signature without its report would be lost in silence
        folder = report_folder(recording, out, optional, quiet=False, kind="acceptance")  # QA always needs the report
        found = app.accept(recording, limits, language=lang)
        result.values |= found.values()
        result.say(str(found))
        if folder is not None:
            files = found.write(folder, key).files
            result.values |= files
            result.say_files(files)
        if found.fails:
            result.fail(found.fails)


def _passphrase() -> str:
    return str(typer.prompt("Passphrase of the key", hide_input=True, err=True))
