"""Built-in excitations."""
