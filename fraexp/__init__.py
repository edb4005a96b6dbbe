"""fraexp: frequency response analysis of machines with friction."""
