"""Titles of the figures of a run: they say what is shown, also where the run has changed its study."""

import shlex
from itertools import pairwise


def run_title(study: str, title: str, command: str) -> str:
    """Return the title of a run's figure: that of its study, unless the command has set values of the study.

    `title` describes the study's file; after ``--set`` it may speak of another grid.
    """
    try:
        words = shlex.split(command)
    except ValueError:  # a run of another program
        words = []
    joined = [word.removeprefix("--set=") for word in words if word.startswith("--set=")]
    apart = [after for word, after in pairwise(words) if word == "--set"]
    changes = [change.replace("=", " = ", 1) for change in (*joined, *apart)]
    return f"{study} with {', '.join(changes)}" if changes else title or study
