"""A study: its file, what it resolves to, and the sweeps that it multiplies into."""
