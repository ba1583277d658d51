"""The search: which of the known effects the data require."""
