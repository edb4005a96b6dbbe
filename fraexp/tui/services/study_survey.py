"""What running each study would do, worked out by a process of its own: to resolve all of them takes seconds."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import asdict

from fraexp.errors import FraexpError
from fraexp.views.study import Surveyed, survey
from fraexp.workspace.workspace import Workspace


class Surveyor:
    """Another process that looks at the studies of a workspace, one after another."""

    def __init__(self, workspace: Workspace) -> None:
        self._arguments = workspace.place()
        self._process: subprocess.Popen[str] | None = None
        self._stopped = False

    def survey(self, tell: Callable[[Surveyed], object], first: Iterable[str] = ()) -> None:
        """Tell of each study as soon as it is known; to be called in a thread, which `stop` ends."""
        place = (text.partition("=")[2] for text in self._arguments)
        command = [sys.executable, "-m", __name__, *place, *first]
        quiet = subprocess.DEVNULL
        with subprocess.Popen(command, stdin=quiet, stdout=subprocess.PIPE, stderr=quiet, text=True) as process:
            self._process = process
            if self._stopped:
                process.kill()
            for line in process.stdout or ():
                if not self._stopped:
                    with suppress(ValueError, TypeError):  # a plugin may have printed it
                        tell(Surveyed(**json.loads(line)))

    def stop(self) -> None:
        """End the process, if there is one, and let none begin."""
        self._stopped = True
        process, self._process = self._process, None
        if process and process.poll() is None:
            process.kill()


def main() -> None:
    """Print a line of JSON for each study of a workspace."""
    folder, database, *first = sys.argv[1:]
    os.nice(5)  # whatever runs comes first
    workspace = Workspace.open(folder, database)
    for found in survey(workspace, workspace.catalogue(), first):
        print(json.dumps(asdict(found)), flush=True)


if __name__ == "__main__":
    with suppress(BrokenPipeError, KeyboardInterrupt, FraexpError):  # a database that cannot be read: the page tells
        main()
