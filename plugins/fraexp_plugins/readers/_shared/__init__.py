"""Helpers of the readers: checks, and the formats of MATLAB files; no component."""
