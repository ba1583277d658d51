"""The data of the live page, read from running and finished campaigns; independent of HTTP."""
