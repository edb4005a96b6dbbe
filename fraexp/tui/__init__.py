"""The terminal UI: a client of the workspace and its database, which computes nothing itself."""
