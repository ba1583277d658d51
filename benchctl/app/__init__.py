"""What users do, one file a task: `benchctl.api`, the command line and the fleet call these."""
