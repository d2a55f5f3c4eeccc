"""Method ``field``: histograms as Gaussian processes over the floor, and a filter of several
hypotheses on top of them.

A k-NN asks which training frame is most similar; a field predicts the histogram of any place, also
between the training frames, with a variance. In flight NumPy is enough; learning takes SciPy.
"""
