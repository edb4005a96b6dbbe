"""Friction models from records of force and displacement."""
