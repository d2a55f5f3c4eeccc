"""One error family: a message says what was found, what was expected, and what to do. Offers
`TrextonError` and one class for each kind of thing that can be wrong."""


class TrextonError(Exception):
    """Base of every error this package raises on purpose; its text is one line."""

    def __str__(self) -> str:
        return " ".join(super().__str__().splitlines())


class FlightError(TrextonError):
    """A flight folder is missing, incomplete or inconsistent."""


class ImageError(TrextonError):
    """An image cannot be read or has the wrong shape."""


class MapError(TrextonError):
    """A texton map cannot be trained, read or used."""


class ParameterError(TrextonError, ValueError):
    """A parameter is unknown or outside its range."""


class DataError(TrextonError):
    """Public data cannot be fetched or fail their hash."""
