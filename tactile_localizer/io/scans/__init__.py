"""Parts of the scan file: what was learned from it."""
