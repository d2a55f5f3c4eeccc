"""The workflow that runs experiments, and the book that is made of their results."""
