"""Helpers of friction identification: records, regression, reports."""
