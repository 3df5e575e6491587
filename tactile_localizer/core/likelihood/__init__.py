"""What a place feels like, and how well a strain fits it."""
