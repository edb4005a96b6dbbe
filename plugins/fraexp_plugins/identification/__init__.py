"""Estimators that identify: the plant, friction, or both together."""
