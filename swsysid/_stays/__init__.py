"""Identification on stays: a method for recordings, measured here before it enters the package.

Between two switches a recording stays in one mode. With the stays given, laws, states and switch
instants of highest likelihood are a smooth problem, in which noise is where it was measured and
nothing is differentiated; with the laws given, the stays are decoded.
"""
