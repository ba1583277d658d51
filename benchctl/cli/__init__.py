"""The command line: one short file a verb. What a verb needs is imported when it runs, so that `--help` is quick."""

from benchctl.cli.app import main

__all__ = ["main"]
