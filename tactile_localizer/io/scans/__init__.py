"""The scan file: writing and reading, its rows and their checksums, import and export, repair."""
