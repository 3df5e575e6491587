"""The whole system at once: nodes as processes that are started, watched, recorded and always ended."""
