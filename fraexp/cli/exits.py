"""The exit codes and their meaning."""

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

    OK = 0, "success"
    INCOMPLETE = 1, "some sweeps failed, gave no usable result or were not computed, or a check failed"
    USAGE = 2, "invalid command line, study, plugin, record or file, or a plan beyond the limits; nothing was played"
    STORE = 3, "the database cannot be used, or lacks the requested run or sweep"
    MACHINE = 4, "the machine cannot be reached, has failed or does not move; measured points are kept"
    LIMIT = 5, "the machine was stopped at a limit; measured points are kept"
    BUSY = 6, "another process measures on the machine, or into the same files; nothing was played"
    INTERNAL = 70, "internal error of fraexp; --debug shows the traceback"
    OUTPUT = 74, "standard output cannot be written, such as on a full disk; what was computed is stored"
    INTERRUPTED = 130, "interrupted; finished sweeps are kept"
    PIPE_CLOSED = 141, "the reader of the output closed the pipe"
