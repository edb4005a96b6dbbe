"""Built-in friction."""
