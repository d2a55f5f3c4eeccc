"""Every figure of the book, drawn from records only; the common look is in `style`."""
