"""The field: what histogram the floor shows at each place, learned as a process, and a tracker on
top of it.

A k-NN asks which training frame looks like this one; a field asks at which place this histogram
would be seen, also between the training frames, and knows how well it knows that. In flight NumPy
is enough; learning takes SciPy.
"""
