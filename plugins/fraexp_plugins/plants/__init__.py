"""Built-in plants."""
