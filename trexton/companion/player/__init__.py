"""A flight to look at, frame by frame: what the camera saw, what the localizer made of it."""
