"""What was selected, told: findings, where model and recording part, what was not found, the verdict."""
