"""The generic arm: sparse regression on a library of terms, as a careful user of pysindy would run it."""
