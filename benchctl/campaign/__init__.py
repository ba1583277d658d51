"""Run a campaign: open the bench, play its steps, watch the limits, and bring the bench to rest in any case."""
