"""The onboard script: frame sources, the loop, position sinks, the landing.

The loop steps the very `trexton.localization.localizer.Localizer` that the notebooks evaluate.
Sources and sinks are registries of classes that declare themselves; what can go wrong is listed in
`trexton.onboard.tally.FAULTS`.
"""
