"""The executable paper: experiments, claims, checks and book, which read the library."""
