"""Parts of the scan file: rows and their checksums, reading, migration, repair, learned results."""
