"""Where a recording and its predictions part, step by step."""
