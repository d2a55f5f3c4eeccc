"""A map and a frame become a position: map, training, parts of methods, localizer."""
