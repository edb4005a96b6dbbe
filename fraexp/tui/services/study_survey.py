"""The survey of all studies in a separate process, as resolving them takes seconds."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress

from pydantic import TypeAdapter

from fraexp.errors import FraexpError
from fraexp.views.study import StudySurvey, survey_studies
from fraexp.workspace.workspace_folder import DATABASE_VARIABLE
from fraexp.workspace.workspace_service import WorkspaceService

SURVEY_LINE = TypeAdapter(StudySurvey)
"""Writes a survey as a line of JSON, and reads it."""


class SurveyProcess:
    """A process that surveys the studies of a workspace, one after another."""

    def __init__(self, workspace: WorkspaceService) -> None:
        self._folder, self._environment = str(workspace.folder.absolute()), workspace.location_environment()
        self._process: subprocess.Popen[str] | None = None
        self._stopped = False

    def survey(self, tell: Callable[[StudySurvey], object], first: Iterable[str] = ()) -> None:
        """Call `tell` with the survey of each study; runs in a thread, which `stop` ends."""
        command = [sys.executable, "-m", __name__, self._folder, *first]
        quiet, environment = subprocess.DEVNULL, os.environ | self._environment
        with subprocess.Popen(
            command, stdin=quiet, stdout=subprocess.PIPE, stderr=quiet, text=True, env=environment
        ) as process:
            self._process = process
            if self._stopped:
                process.kill()
            for line in process.stdout or ():
                if not self._stopped:
                    with suppress(ValueError):  # a line that a plugin has printed
                        tell(SURVEY_LINE.validate_json(line))

    def stop(self) -> None:
        """Kill the process, and prevent that another one starts."""
        self._stopped = True
        process, self._process = self._process, None
        if process and process.poll() is None:
            process.kill()


def main() -> None:
    """Print a line of JSON for each study of a workspace."""
    folder, *first = sys.argv[1:]
    os.nice(5)  # running studies have priority
    workspace = WorkspaceService.open(folder, os.environ[DATABASE_VARIABLE])
    for found in survey_studies(workspace, workspace.catalogue(), first):
        print(SURVEY_LINE.dump_json(found).decode(), flush=True)


if __name__ == "__main__":
    with suppress(BrokenPipeError, KeyboardInterrupt, FraexpError):  # the page reports an unreadable database
        main()
