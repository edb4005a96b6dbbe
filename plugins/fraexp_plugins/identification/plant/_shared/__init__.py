"""Helpers of the plant fit: the model, its start values, its order, its solver."""
