"""The folder that a user sees, as one object: the service that every face calls."""
