"""What to do on the bench, one file a procedure. A procedure imports `benchctl.plan` and nothing else of the suite."""
