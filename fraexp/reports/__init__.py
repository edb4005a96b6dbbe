"""Reports of stored runs."""
