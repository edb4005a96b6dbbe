"""What is raised for a friction law that cannot be compiled; the compiler itself need not have been imported."""


class LawError(Exception):
    """A law is not written in the part of Python that can be compiled: in one line, with its file and line."""
