"""CSV recordings: the names and units of their columns, and their samples."""
