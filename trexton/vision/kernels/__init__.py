"""Hot loops compiled by numba, loaded when they are first needed."""
