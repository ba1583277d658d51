"""What the live page shows, read from campaigns that run and campaigns that are over; it knows nothing of HTTP."""
