"""The localizer on a stream of messages, built from scan files."""
