"""Helpers of the estimators: delays, realisations, windows, local models, the observer."""
