"""The command line: a module a verb of the library, with ``add_arguments`` and ``run``."""
