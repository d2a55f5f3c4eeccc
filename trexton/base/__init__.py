"""What every room stands on: errors, options, plugins, files, random streams, records."""
