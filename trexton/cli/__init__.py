"""The command line of the library. Each verb is a module with ``add_arguments`` and ``run``."""
