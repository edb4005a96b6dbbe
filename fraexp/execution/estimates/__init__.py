"""Estimate of the duration of a run: its work, at the measured speed of this machine."""
