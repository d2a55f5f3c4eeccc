"""The paper's settings, which hold unless others are asked for (Sec. Analysis)."""

TEXTONS = 20  # of the dictionary, K
PATCH = 6  # side of a patch, pixels
SAMPLES = 400  # patches drawn from an image
NEIGHBORS = 5  # of a frame, k
PARTICLES = 50  # of the filter
# Parts along each side into which a method wants images cut, each with a histogram of its own, if
# the training flight shows where each looks; one where none is said.
USUAL_CELLS = {"field": 2}
