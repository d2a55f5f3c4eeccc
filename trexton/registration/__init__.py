"""Method `fine`: where a frame lies on a picture of the floor, to a fraction of a pixel.

Normalised cross-correlation at a coarse resolution gives a belief over the whole floor, moved from
frame to frame by visual odometry; optical flow against the view expected at the most likely places
gives the camera's pose. Beside it: the mosaic that makes such a picture, the paper's homography.
"""
