"""Helpers of all identification: least squares, stop operators, curves of friction."""
