"""How good a map or a floor is. Blocked cross-validation, and the map loss of the paper."""
