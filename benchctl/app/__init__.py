"""The tasks of benchctl, one module per task: used by `benchctl.api`, the command line and the fleet."""
