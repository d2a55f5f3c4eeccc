"""Notebooks run by an engine that reuses what is true, and the book that is made of them."""
