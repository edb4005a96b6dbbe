"""Estimators: one component in each module, their helpers in `_shared`."""
