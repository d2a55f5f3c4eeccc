"""What every room stands on: errors, options, plugins, files, streams of random numbers, records."""
