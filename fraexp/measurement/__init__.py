"""Measurements on machines: what is played, whether that is safe, what is recorded, and when it is enough."""
