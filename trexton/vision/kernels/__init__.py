"""What numba compiles. Offers `compiled`, which keeps the machine code where there is a place."""

from __future__ import annotations

from numba import njit


def compiled(**options):
    """Numba's `njit`: what it makes is kept beside the module or in the user's cache.

    Where neither can be written to, as for a service without a home, it is made at each start.
    """

    def decorate(function):
        try:
            return njit(cache=True, nogil=True, **options)(function)
        except RuntimeError:  # no place
            return njit(nogil=True, **options)(function)

    return decorate
