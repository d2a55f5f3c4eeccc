"""How good a position or a floor is. Metrics with intervals, and the map loss of the paper."""
