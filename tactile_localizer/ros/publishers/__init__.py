"""Publishers of estimates, maps and transforms."""
