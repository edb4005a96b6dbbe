"""A few thousand hostile inputs for all parsers; `benchmarks/long_draws.py` feeds as many as one likes."""

import signal
from random import Random
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fraexp.components.registry import Registry
from fraexp.views.words import flatten
from tests.examples import portion
from tests.fuzz import bombs, files, targets
from tests.fuzz.watching import LONGEST, Tally, Target, feed, short

INPUTS = 3000
SEED = 20261121

pytestmark = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="there is no alarm on this system")


@pytest.fixture(scope="module")
def parsers(tmp_path_factory: pytest.TempPathFactory, registry: Registry) -> dict[str, Target]:
    return {one.name: one for one in targets.targets(tmp_path_factory.mktemp("parsers"), registry)}


@pytest.fixture(scope="module")
def every(
    tmp_path_factory: pytest.TempPathFactory, registry: Registry, parsers: dict[str, Target]
) -> dict[str, Target]:
    folder = tmp_path_factory.mktemp("fuzz")
    return parsers | {one.name: one for module in (files, bombs) for one in module.targets(folder, registry)}


def told(tally: Tally) -> str:
    return "\n".join(f"{finding}: {short(made)}" for finding, made in tally.findings.items())


@pytest.mark.thorough
def test_no_parser_raises_hangs_or_grows(every: dict[str, Target]) -> None:
    for target in every.values():
        tally = feed(target, SEED, max(round(portion(INPUTS) * target.share), 2))
        assert not tally.findings, f"{target.name}: {told(tally)}"
        assert tally.inputs == tally.refused + tally.accepted


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.dates(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=6,
)
VALID = {
    "studies as data": [data for _, data in targets.packaged()],
    "record sections": list(targets.RECORDS),
    "random sections": list(targets.RANDOM),
}


@settings(max_examples=portion(200), suppress_health_check=[HealthCheck.too_slow])
@given(name=st.sampled_from(sorted(VALID)), data=st.data(), value=PLAIN)
def test_any_value_in_place_of_a_valid_one_is_taken_or_refused(
    parsers: dict[str, Target], name: str, data: st.DataObject, value: Any
) -> None:
    valid = data.draw(st.sampled_from(VALID[name]))
    path = data.draw(st.sampled_from(list(flatten(valid))))
    made = put(valid, path.split("."), value)
    tally = feed(Target(name, lambda rng: made, parsers[name].parse, 1.0), 0, 1)
    assert not tally.findings, told(tally)


def put(data: Any, path: list[str], value: Any) -> Any:
    """Return data with a value at a path, as far as that leads."""
    if not path or not isinstance(data, dict | list):
        return value
    if isinstance(data, list):
        return [put(of, path[1:], value) if str(place) == path[0] else of for place, of in enumerate(data)]
    key = next((key for key in data if path[: key.count(".") + 1] == key.split(".")), path[0])  # may have dots itself
    return {**data, key: put(data.get(key), path[key.count(".") + 1 :], value)}


def test_what_is_looked_for_is_found() -> None:
    def hangs(made: object) -> None:
        while True:
            pass

    def raises(made: object) -> None:
        raise ZeroDivisionError("1/0")

    assert list(feed(Target("raises", Random.random, raises, 1.0), 1, 2).findings) == ["ZeroDivisionError at ?: '1/0'"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tests.fuzz.watching.LONGEST", LONGEST / 300)
        assert "hang in hangs" in feed(Target("hangs", Random.random, hangs, 1.0), 1, 1).findings
