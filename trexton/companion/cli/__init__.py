"""The companion's verbs, a module each. They have ``add_arguments`` and ``run``, and no logic."""
