"""What the exit codes mean."""

from enum import IntEnum


class ExitCode(IntEnum):
    """An exit code and its sentence."""

    sentence: str

    def __new__(cls, code: int, sentence: str) -> "ExitCode":
        """Take the number for the code, and keep the sentence."""
        member = int.__new__(cls, code)
        member._value_ = code
        member.sentence = sentence
        return member

    OK = 0, "all is well"
    INCOMPLETE = 1, "some sweeps failed, did not come to a result or were not reached, or a check failed"
    USAGE = 2, "wrong command line, study, plugin, record or file"
    STORE = 3, "the database cannot be used, or lacks what was asked for"
    INTERNAL = 70, "an error of fraexp itself; --debug shows the traceback"
    INTERRUPTED = 130, "interrupted; what was finished is kept"
    PIPE_CLOSED = 141, "the reader of the output went away"
