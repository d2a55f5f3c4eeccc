"""The experiments, a module each. What several share stands beside them."""
