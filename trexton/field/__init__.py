"""Method ``field``: histograms as Gaussian processes over the floor, and a filter of several
hypotheses on top of them. In flight NumPy is enough; learning takes SciPy.
"""
