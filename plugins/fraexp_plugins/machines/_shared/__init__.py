"""What machines share; no component."""
