"""Helpers of the fit to whole records: the likelihood, the records along which a model is replayed, the solver."""
