"""The acceptance report: what the tests of a gyro found, for QA, for CI and for programs; in English and in Russian."""
