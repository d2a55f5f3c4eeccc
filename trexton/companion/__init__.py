"""The executable paper. Experiments, claims, checks and book read the library, which reads nothing
of them."""
