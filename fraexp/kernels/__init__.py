"""Compiled inner loops on bare SI floats; numpy and numba only."""
