"""Messages from and to the values of the core."""
