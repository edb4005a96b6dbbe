"""The plant model from a frequency response."""
