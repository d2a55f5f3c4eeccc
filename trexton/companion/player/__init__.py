"""A flight to look at, frame by frame. Image and estimate stand side by side."""
