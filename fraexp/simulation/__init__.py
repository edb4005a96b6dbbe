"""Signals from a simulated machine: its linear part, its loop, its experiments and limits."""
