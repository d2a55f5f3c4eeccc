"""How the floor looks in flight, as a role of a method. It is taken as it is, or followed."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from trexton.base.errors import MapError
from trexton.field.appearance_filter import AppearanceFilter
from trexton.field.field import Field
from trexton.localization.base import Part, learned
from trexton.localization.texton_map import TextonMap
from trexton.localization.training_set import Training

HELD = 0.98  # mean resultant length of the yaw of a survey that held its heading


class Appearance(Part):
    """Base of all that take the appearance of the floor out of a frame."""

    def open(self, texton_map: TextonMap, rng: np.random.Generator) -> AppearanceFilter | None:
        """For one flight; None where frames are taken as they are."""
        return None


class AsSurveyed(Appearance):
    """Frames are taken as they are, as in the paper."""


@dataclass(eq=False)
class Tracked(Appearance):
    """Follows light, heading and height by the evidence of a field; nothing of histograms."""

    needs = {"measurement": Field}
    survey_yaw: np.ndarray = learned()  # () radians, of a survey that held its heading; else NaN

    def fit(self, training: Training) -> Self:
        """Learn the heading of the survey, from which a yaw in flight is counted."""
        flight, yaw = training.flight, np.nan
        if flight is not None and flight.attitude is not None:
            turned = flight.attitude[:, 2]
            east, north = np.nanmean([np.cos(turned), np.sin(turned)], 1)
            yaw = float(np.arctan2(north, east)) if np.hypot(east, north) > HELD else np.nan
        return self.with_learned(survey_yaw=np.array(yaw))

    def prepare(self) -> None:
        yaw = self.survey_yaw
        if yaw.shape or yaw.dtype.kind != "f" or np.isinf(yaw):
            raise MapError(f"the survey's yaw is {yaw.dtype} of {yaw.shape}: train the map again")

    def open(self, texton_map: TextonMap, rng: np.random.Generator) -> AppearanceFilter | None:
        if texton_map.dictionary is None:
            return None
        return AppearanceFilter(texton_map, rng.spawn(1)[0], float(self.survey_yaw))
