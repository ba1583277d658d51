"""What a gyro is worth: its deviations over averaging times, and what noise they are made of."""
