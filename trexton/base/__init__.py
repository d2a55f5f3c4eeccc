"""What every room stands on. It offers errors, options, plugins, files, streams and records."""
