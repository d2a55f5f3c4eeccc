"""Speed, settings and reference values, measured and compared."""
