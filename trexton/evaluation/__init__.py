"""How good a position or a floor is: metrics with intervals, the map loss of the paper."""
