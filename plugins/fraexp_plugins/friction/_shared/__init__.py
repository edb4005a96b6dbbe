"""Base classes and parts of friction models; no component."""
