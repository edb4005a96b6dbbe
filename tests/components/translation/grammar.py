"""The grammar of Structured Text, by blark: a parser of IEC 61131-3 and TwinCAT's dialect that others wrote."""

import re

from blark.parse import parse_source_code

LONG_LIST = re.compile(r"\[((?:[^\[\],]+,){3})[^\[\]]{200,},([^\[\],]+)\]")
"""A list of many numbers, for which the parser would take minutes."""


def grammar_error(text: str) -> Exception | None:
    """Return what is wrong with the syntax of a source in Structured Text; None if nothing is."""
    error: Exception | None = parse_source_code(LONG_LIST.sub(r"[\1\2]", text)).exception
    return error
