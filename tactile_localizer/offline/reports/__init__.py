"""Reports to send: one HTML file each, which loads nothing from elsewhere."""
