"""How good a map is, by its training flight alone: blocked cross-validation."""
