"""Running a campaign: opening the bench, playing steps, watching limits, coming to rest whatever happens."""
