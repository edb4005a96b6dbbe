import json
from argparse import Namespace
from collections.abc import Generator
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import RunEvents, follow, print_outcome
from fraexp.data.findings import remarks
from fraexp.data.results import Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.execution.events import Begun, Ended, Event, Finished, Planned, Preparing, Progress, TimeLeft
from fraexp.store import Store
from fraexp.views.words import short_key
from fraexp.workspace.workspace_service import WorkspaceService

PLANNED = Planned("bench", "Two sensors", 5, 3, 2, 1, TimeLeft(65.0, 7, 0))


@pytest.fixture
def arguments(workspace: Path) -> Namespace:
    return Namespace(db=None, workspace=workspace, json=False)


def test_events_become_talk_on_stderr(sweeps: list[Sweep], capsys: pytest.CaptureFixture[str]) -> None:
    events: list[Event] = [
        PLANNED,
        Begun(1),
        Preparing("starting 2 workers"),
        Progress(0.5, 2),
        Finished(sweeps[0], None, "reused"),
        Finished(sweeps[4], None, "failed", "ZeroDivisionError: \x1b[31mdivision"),
        Ended(1, "partial"),
    ]
    followed = follow(event for event in events)
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.splitlines() == [
        "bench: 5 sweeps, 3 reused (1 stale: a plugin's source has changed; --rerun stale), 2 to compute, about "
        "1 min 05 s, from 7 like sweeps",
        "starting 2 workers",
        rf"{short_key(sweeps[4].key)} failed: ZeroDivisionError: \x1b[31mdivision",
    ]
    assert (followed.begun, followed.ended, followed.interrupted) == ([1], [Ended(1, "partial")], False)


def told(followed: RunEvents, arguments: Namespace) -> ExitCode:
    return print_outcome(followed, arguments, WorkspaceService.open(arguments.workspace))


def test_ctrl_c_closes_the_events_and_tells_what_is_kept(
    arguments: Namespace, sweeps: list[Sweep], capsys: pytest.CaptureFixture[str]
) -> None:
    closed = []

    def events() -> Generator[Event, None, None]:
        try:
            yield PLANNED
            yield Begun(1)
            yield Finished(sweeps[0], None, "computed")
            raise KeyboardInterrupt
        finally:
            closed.append(True)

    assert told(follow(events()), arguments) == ExitCode.INTERRUPTED
    assert closed == [True]
    # Four are stored of the run, though one was told of.
    assert "stopped by you: 4 sweeps computed and kept; the same command continues" in capsys.readouterr().err


def test_the_end_is_a_table_the_run_and_its_figure(
    arguments: Namespace, sweeps: list[Sweep], capsys: pytest.CaptureFixture[str]
) -> None:
    followed = RunEvents(ended=[Ended(1, "partial", (Path("figures/bench.png"), Path("figures/bench-2.png")))])
    assert told(followed, arguments) == ExitCode.INCOMPLETE
    printed = capsys.readouterr()
    lines = printed.out.splitlines()
    assert lines[0] == "magnitudes in dB re 1 mm/N"
    assert lines[1].split()[:2] == ["sweep", "output"]
    assert [line.split()[0] for line in lines[2:7]] == [short_key(sweep.key) for sweep in sweeps]
    assert lines[-3].startswith("run 1 partial: 5 sweeps, 4 computed, 0 reused, 1 failed")
    assert lines[-2:] == ["figure figures/bench.png", "figure figures/bench-2.png"]
    here = f" --workspace {arguments.workspace}"
    assert f"next: fraexp show 1{here}, fraexp show {short_key(sweeps[0].key)}{here}, fraexp plot 1 -o" in printed.err


def test_a_run_as_json_is_one_document(arguments: Namespace, capsys: pytest.CaptureFixture[str]) -> None:
    arguments.json = True
    assert told(RunEvents(planned=[PLANNED], ended=[Ended(1, "partial")]), arguments) == ExitCode.INCOMPLETE
    document = json.loads(capsys.readouterr().out)
    assert document["planned"][0]["reused"] == 3
    assert document["runs"][0]["number"] == 1
    assert [sweep["state"] for sweep in document["runs"][0]["sweeps"]] == ["computed"] * 4 + ["failed"]


@pytest.mark.parametrize(
    ("outcome", "code"),
    [
        (Outcome.OK, ExitCode.OK),
        (Outcome.NOT_SETTLED, ExitCode.OK),
        (Outcome.NO_MOTION, ExitCode.INCOMPLETE),
        (Outcome.DIVERGED, ExitCode.INCOMPLETE),
    ],
)
def test_outcomes_decide_the_exit_code_and_nothing_is_plotted_where_nothing_is(
    outcome: Outcome, code: ExitCode, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sweep = Sweep({"source": "drive"}, {"name": "hysteresis"}, {"x": 1})
    with Store.open(str(tmp_path / "results.db"), create=True) as store:
        run = store.begin_run("one", "one.toml", "fraexp run one", {}, [sweep])
        store.save(run, [(sweep, Result(outcome, remarks("why")), {})])
        store.end_run(run, "complete")
    arguments = Namespace(db=None, workspace=tmp_path, json=False)
    assert told(RunEvents(ended=[Ended(run, "complete", note="two\nlines")]), arguments) == code
    printed = capsys.readouterr()
    assert outcome.name.lower().replace("_", " ") in printed.out
    assert "run 1: no figure was drawn: two lines\n" in printed.err
    assert "fraexp plot" not in printed.err
