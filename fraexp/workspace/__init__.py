"""A workspace folder as one object: the service that command line and terminal UI call."""
