"""What a laboratory adds to benchctl."""
