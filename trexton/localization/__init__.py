"""A map and a frame become a position. Map, training, parts of methods, localizer."""
