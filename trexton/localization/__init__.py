"""A map and a frame become a position: the map, its training, the parts of methods, the localizer."""
