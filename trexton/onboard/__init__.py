"""The onboard script: frame sources, the loop, position sinks, the landing.

The loop steps the very `trexton.localization.localizer.Localizer` that the notebooks evaluate.
Sources and sinks are registries of classes that declare themselves; what can go wrong is listed in
`trexton.onboard.tally.FAULTS`.
"""

from trexton.onboard.build import build
from trexton.onboard.fix import Fix
from trexton.onboard.loop import Onboard
from trexton.onboard.settings import Settings

__all__ = ["Fix", "Onboard", "Settings", "build"]
