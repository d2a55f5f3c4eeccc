"""``python -m trexton``."""

import sys

from trexton.cli.main import main

sys.exit(main())
