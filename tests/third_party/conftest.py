"""The example's own tests run where it is installed: `test_example_lab.py` installs it."""

collect_ignore = ["example_lab"]
