"""The acceptance report for QA, CI and programs, in English and in Russian."""
