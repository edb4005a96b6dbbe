"""Built-in machines: simulated ones, and what connects real ones."""
