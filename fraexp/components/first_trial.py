"""The first trial of a dropped-in friction law, in a process of its own: a call that never returns ends with it."""

import faulthandler
import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fraexp.components.kinds import FrictionModel
from fraexp.components.registry import LOCAL, Registry, create, discover
from fraexp.data.identity import file_hash
from fraexp.errors import FraexpError, PluginError
from fraexp.kernels.watchdog import LAW_TIME_LIMIT_S, place_in_dump

GRACE_S = 2.0
"""Time for a law that can be interrupted to be interrupted."""
WRONG = 3
"""Exit code of the process if the law is wrong; its last line on stderr says why."""
_passed: set[tuple[str, str]] = set()
"""Laws that have come back, by name and source."""


def first_trial(spec: Mapping[str, Any], registry: Registry) -> None:
    """Try a dropped-in law in another process until it has passed once; PluginError for what is wrong with it.

    So it is for a law that never returns, or that ends its process. Laws of installed packages are trusted.
    """
    supply = registry.supply(FrictionModel.kind, str(spec["name"]))
    if supply.distribution != LOCAL:
        return
    tried = (str(spec["name"]), file_hash(supply.file))
    if tried in _passed:
        return
    command = [sys.executable, "-m", __name__, str(supply.file.parent), json.dumps(dict(spec))]
    done = subprocess.run(
        command, stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace", check=False
    )
    if done.returncode:
        raise PluginError(_bad_end(done, tried[0], supply.file))
    _passed.add(tried)


def _bad_end(done: "subprocess.CompletedProcess[str]", name: str, file: Path) -> str:
    """Return why the process ended: what it said of the law, or where the law was when it never returned."""
    place = place_in_dump(done.stderr.splitlines(), str(file))
    if place:
        found = f"the law of {name} ({place}) has not returned after {LAW_TIME_LIMIT_S + GRACE_S:g} s"
        return f"{found}; expected a force at once: mend what it calls"
    said = done.stderr.strip().splitlines()[-1:] if done.returncode == WRONG else []
    return said[0] if said else f"the law of {name} ({file.name}) ended the process that tried it; expected a force"


def main() -> None:
    """Try the law of the second argument, as JSON, found in the folder that is the first."""
    folder, spec = sys.argv[1:]
    registry = discover(Path(folder))
    faulthandler.dump_traceback_later(LAW_TIME_LIMIT_S + GRACE_S, exit=True)
    try:
        create(registry, FrictionModel, json.loads(spec)).rehearse()
    except FraexpError as error:
        print(error, file=sys.stderr)
        sys.exit(WRONG)
    except Exception:  # a stranger's law may raise anything: it does so where it is tried next, too
        return


if __name__ == "__main__":
    main()
