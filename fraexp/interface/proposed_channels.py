"""What `read_record` needs to know of a file, as far as names, units and values in the file support a proposal."""

from itertools import pairwise
from pathlib import Path

from fraexp.components.registry import Registry
from fraexp.errors import ParameterError

KEYWORDS = {"--time": "time_column", "--aperiodic": "periodic"}
"""Arguments that are not called like the option of ``fraexp import`` which means the same."""
OPTIONS_WITH_TEXT = ("--time", "--resample", "--unit")


def missing_channels(file: Path, registry: Registry) -> ParameterError:
    """Return the error for a record without channels, which proposes some as ``fraexp import FILE`` does."""
    from fraexp.records.contents import list_contents
    from fraexp.records.proposals import propose_import

    found = list_contents(file, registry)
    proposal = propose_import(file, found, registry)
    needs = "".join(f"; {need}" for need in proposal.needs)
    return ParameterError(f"read_record needs channels; probably {_call_text(proposal.words)}{needs}")


def _call_text(words: list[str]) -> str:
    """Return the options of a command as arguments in Python."""
    pairs = [(word, value) for word, value in pairwise([*words, ""]) if word.startswith("--")]
    channels = dict(value.split("=", 1) for word, value in pairs if word == "--channel")
    others = [_argument_text(*pair) for pair in pairs if pair[0] not in ("--channel", "--estimator", "--level")]
    return ", ".join([f"channels={channels!r}", *others])


def _argument_text(option: str, value: str) -> str:
    name = KEYWORDS.get(option, option.removeprefix("--").replace("-", "_"))
    if option == "--aperiodic":
        return f"{name}=False"
    return f"{name}={value!r}" if option in OPTIONS_WITH_TEXT else f"{name}={value}"
