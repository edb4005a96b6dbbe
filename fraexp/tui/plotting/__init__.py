"""Plots in the terminal: curves and axes drawn with characters, and their export as a figure."""
