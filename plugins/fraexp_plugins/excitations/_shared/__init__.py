"""Base classes and helpers of excitations; no component."""
