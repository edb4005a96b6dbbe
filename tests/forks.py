"""Python programs as forks of the test process, which has imported what each of them would import again."""

import os
import runpy
import subprocess
import sys
import traceback
import warnings
from typing import Any


class ForkedPython(subprocess.Popen[str]):
    """``python -m`` and ``python -c`` as a fork of this process; another program is started as usual.

    It is for tests in which another process matters, and not how it begins.
    """

    def _execute_child(self, command: list[str], *options: Any) -> None:
        if os.name != "posix" or command[0] != sys.executable or command[1] not in ("-m", "-c"):
            super()._execute_child(command, *options)  # type: ignore[misc]
            return
        folder, environment, pipes = options[4], options[5], options[9:15]
        sys.stdout.flush()
        self.pid = os.fork()
        if self.pid == 0:
            try:
                for number, end in enumerate((pipes[0], pipes[3], pipes[5])):
                    if end != -1:
                        os.dup2(end, number)
                os.setsid()
                os.closerange(3, 1024)  # locks and connections of this process
                os.chdir(folder or ".")
                os.environ |= environment or {}
                os._exit(run(command))
            finally:
                os._exit(1)
        self._child_created = True
        self._close_pipe_fds(*pipes)  # type: ignore[attr-defined]


def run(command: list[str]) -> int:
    """Run a program in this process, and return its exit code."""
    sys.stdin, sys.stdout, sys.stderr = map(os.fdopen, range(3), "rww")
    _, option, program, *sys.argv[1:] = command
    code: Any = 0
    try:
        if option == "-c":
            exec(compile(program, "<string>", "exec"), {"__name__": "__main__"})
        else:
            warnings.filterwarnings("ignore", module="runpy")  # the program may have been imported
            runpy.run_module(program, run_name="__main__", alter_sys=True)
    except SystemExit as end:
        code = end.code or 0
    except BaseException:
        code = traceback.print_exc() or 1
    sys.stdout.flush()
    sys.stderr.flush()
    return code if isinstance(code, int) else 1
