"""Reports of results: tables, HTML pages, JSON files."""
