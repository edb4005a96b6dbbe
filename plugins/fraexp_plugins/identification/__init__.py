"""Estimators that identify: plant, friction, or both."""
