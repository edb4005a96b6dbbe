"""Run `make test` again and again: on the machine as it is, beside other work, and held to half a core.

    python benchmarks/suite_endurance.py                            10 times, 3 times under load, 2 times held
    python benchmarks/suite_endurance.py --quiet 1 --load 0 --held 0
    python benchmarks/suite_endurance.py --load 1 --whole           the whole suite, `make test-all`, in place of it

Load is a process on each core that computes all the time. Held processes share half a core: by a quota of Linux's
control groups, which takes root, or else by cpulimit. Exit code 1 if a run fails.
"""

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[1]
HELD_CORES = 0.5
PERIOD_US = 100_000
GROUPS = (Path("/sys/fs/cgroup/cpu"), Path("/sys/fs/cgroup"))
"""Where control groups are: their first version, and their second."""
BUSY = "while True: pass"
Wrapper = Callable[[list[str]], AbstractContextManager[list[str]]]
"""Prepares a condition, and returns the command that runs another one in it."""


def main() -> int:
    """Print how often the suite has passed in each condition, and return 1 if it has failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, (times, _) in CONDITIONS.items():
        parser.add_argument(f"--{name}", type=int, default=times, metavar="TIMES")
    parser.add_argument("--whole", action="store_true", help="make test-all in place of make test")
    options = parser.parse_args()
    target = "test-all" if options.whole else "test"
    print(f"make {target:10} {'passed':>7} {'failed':>7} {'median [min]':>13} {'longest [min]':>14}", flush=True)
    failed = [repeat(target, name, getattr(options, name)) for name in CONDITIONS if getattr(options, name) > 0]
    return int(any(failed))


def repeat(target: str, condition: str, times: int) -> int:
    """Run a target some times in a condition, print its row, and return how often it has failed."""
    minutes, failed = [], 0
    for number in range(1, times + 1):
        began = time.monotonic()
        passed, text = run(target, condition)
        minutes.append((time.monotonic() - began) / 60)
        failed += not passed
        last = text.rstrip().splitlines()[-1] if text.strip() else "it has said nothing"
        print(f"{condition} {number}: {minutes[-1]:.1f} min, {last}", file=sys.stderr, flush=True)
        if not passed:
            print(text, file=sys.stderr, flush=True)
    row = f"{times - failed:7} {failed:7} {statistics.median(minutes):13.1f} {max(minutes):14.1f}"
    print(f"{condition:15} {row}", flush=True)
    return failed


def run(target: str, condition: str) -> tuple[bool, str]:
    """Run a target in a condition, and return whether it has passed and what it has said."""
    with CONDITIONS[condition][1](["make", "--silent", target]) as command:
        done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    return done.returncode == 0, done.stdout.decode(errors="replace")


@contextmanager
def alone(command: list[str]) -> Iterator[list[str]]:
    """Leave the machine as it is."""
    yield command


@contextmanager
def loaded(command: list[str]) -> Iterator[list[str]]:
    """Keep every core busy."""
    with ExitStack() as stack:
        for _ in range(os.cpu_count() or 1):
            process = stack.enter_context(subprocess.Popen([sys.executable, "-c", BUSY]))
            stack.callback(process.kill)
        yield command


@contextmanager
def held(command: list[str]) -> Iterator[list[str]]:
    """Give all processes of the command half a core together."""
    if (group := make_group()) is not None:
        joined = ["sh", "-c", f'echo $$ > "{group}/cgroup.procs" && exec "$@"', "sh", *command]
        try:
            yield joined
        finally:
            remove_group(group)
    elif shutil.which("cpulimit"):
        yield ["cpulimit", f"--limit={round(100 * HELD_CORES)}", "--include-children", "--foreground", "--", *command]
    else:
        raise SystemExit("held: needs the right to make a control group with a quota (root), or cpulimit")


def make_group() -> Path | None:
    """Return a control group that may use half a core; None where none can be made."""
    quota = round(HELD_CORES * PERIOD_US)
    for parent in GROUPS:
        try:
            group = Path(tempfile.mkdtemp(prefix="fraexp-", dir=parent))
        except OSError:
            continue
        for file, text in (("cpu.cfs_quota_us", f"{quota}"), ("cpu.max", f"{quota} {PERIOD_US}")):
            if (group / file).exists():
                (group / file).write_text(text)
                return group
        group.rmdir()
    return None


def remove_group(group: Path) -> None:
    """End what is left in a control group, and remove it."""
    for pid in (group / "cgroup.procs").read_text().split():
        subprocess.run(["kill", "-9", pid], check=False, stderr=subprocess.DEVNULL)
    while (group / "cgroup.procs").read_text():
        time.sleep(0.1)
    group.rmdir()


CONDITIONS: dict[str, tuple[int, Wrapper]] = {"quiet": (10, alone), "load": (3, loaded), "held": (2, held)}

if __name__ == "__main__":
    sys.exit(main())
