"""Progress of runs and of single computations, in a notebook's cell or on standard error."""

from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager
from functools import cache

from fraexp.cli.follow import follow
from fraexp.cli.progress import Meter
from fraexp.components.first_trial import friction_specs
from fraexp.data.sweep import Plain
from fraexp.execution.events import Ended, Event
from fraexp.interface.callable_law import compiler_errors_as_ours
from fraexp.kernels.announcement import compilation_listener


def follow_run(events: Generator[Event, None, None], is_shown: bool) -> Ended:
    """Return how a run ended; with `is_shown`, show its plan, progress and failures meanwhile.

    KeyboardInterrupt, after the run was stopped and its finished sweeps were stored, for an interrupt.
    """
    followed = follow(events, is_shown)
    run = followed.begun[-1] if followed.begun else None
    if followed.interrupted:
        raise KeyboardInterrupt(
            f"run {run} is stopped; its finished sweeps are kept, and the same call continues"
            if run is not None
            else "the run had not begun"
        )
    return followed.ended[-1] if followed.ended else Ended(run, "interrupted")


@contextmanager
def computing_meter(computed: Plain) -> Iterator[Callable[[float], None]]:
    """Show the progress of one computation that takes long, and say once that something is compiled for it."""
    meter = Meter()
    with compiler_errors_as_ours(), meter.bar:
        note = cache(lambda: meter.note(f"compiling {_compiled_text(computed)} (once per machine)"))
        with compilation_listener(lambda begins: note() if begins else None):
            yield lambda fraction: meter.move(fraction, 1.0)


def _compiled_text(computed: Plain) -> str:
    """Return what is compiled for a computation: its friction laws, or those that its estimator tries."""
    laws = dict.fromkeys(f"'{spec['name']}'" for spec in friction_specs([computed]))
    subject = f"friction law {' and '.join(laws)}" if laws else "the friction law"
    estimator = computed.get("estimator")
    return f"{subject} for {estimator['name']}" if isinstance(estimator, Mapping) else subject
