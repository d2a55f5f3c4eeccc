"""Every figure of the book, drawn from result records only; one module an experiment, the common look in `style`."""
