"""The hyperspatial image: one picture of the floor from a flight's own frames (Sec. "Dataset
Generation").

The paper used a closed program for this. Here frames are linked by keypoints, all their poses are
adjusted at once over a plane, and the frames are blended; a handful of motion-capture positions
place the picture in the world.
"""

from trexton.registration.links import Links
from trexton.registration.stitching import Mosaic, map_from_links, stitch

__all__ = ["Links", "Mosaic", "map_from_links", "stitch"]
