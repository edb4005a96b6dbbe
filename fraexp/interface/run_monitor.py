"""Progress of runs and of single computations, in a notebook's cell or on standard error."""

from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager, suppress

from fraexp.cli.follow import follow
from fraexp.cli.progress import Meter
from fraexp.components.first_trial import friction_specs
from fraexp.data.sweep import Plain
from fraexp.execution.events import Begun, Ended, Event
from fraexp.interface.compiled_laws import compiler_errors_as_ours
from fraexp.kernels.announcement import compilation_listener


def follow_run(events: Generator[Event, None, None], is_shown: bool) -> Ended:
    """Return how a run ended; with `is_shown`, show its plan, progress and failures meanwhile."""
    if is_shown:
        followed = follow(events)
        run = followed.begun[-1] if followed.begun else None
        return followed.ended[-1] if followed.ended else Ended(run, "interrupted")
    run, ended = None, None
    with suppress(KeyboardInterrupt), closing(events):
        for event in events:
            if isinstance(event, Begun):
                run = event.run
            elif isinstance(event, Ended):
                ended = event
    return ended or Ended(run, "interrupted")


@contextmanager
def computing_meter(experiment: Plain) -> Iterator[Callable[[float], None]]:
    """Show the progress of one computation that takes long, and say so while a friction law is compiled."""
    laws = " and ".join(dict.fromkeys(f"'{spec['name']}'" for spec in friction_specs([experiment])))
    with (
        compiler_errors_as_ours(),
        Meter() as meter,
        compilation_listener(lambda: meter.note(f"compiling friction law {laws} (once per machine)")),
    ):
        yield lambda fraction: meter.move(fraction, 1.0)
