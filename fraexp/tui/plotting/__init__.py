"""Plots of characters: curves, axes, and the figure that a screen shows as a file."""
