"""Fields to sort by, as users type them: a heading that they see, or the beginning of one."""

from collections.abc import Collection, Mapping

from fraexp.errors import FraexpError, did_you_mean

HEADINGS = {"sweep": "key", "took": "elapsed"}
"""Headings of a listing of sweeps that are not the name of their field."""


def complete_field(
    wanted: str, fields: Collection[str], headings: Mapping[str, str] = HEADINGS, place: str = "list: --sort"
) -> str:
    """Return the field that a name stands for, with the ``-`` of descending order that it may begin with.

    The name is a field, a heading, the last part of a field, or the beginning of one of them. FraexpError, which names
    the `place` of the input, otherwise.
    """
    sign, name = ("-", wanted[1:]) if wanted.startswith("-") else ("", wanted)
    columns = {field: field for field in fields if "." not in field} | dict(headings)
    whole = {**columns, **{field: field for field in fields}}
    if name in whole:
        return sign + whole[name]
    parts = [(field.rpartition(".")[2], field) for field in fields]
    tiers = (
        {field for part, field in parts if part == name},
        {field for title, field in columns.items() if name and title.startswith(name)},
        {field for part, field in parts if name and (part.startswith(name) or field.startswith(name))},
    )
    found = next((tier for tier in tiers if tier), set())
    if len(found) == 1:
        return sign + found.pop()
    if found:
        raise FraexpError(f"{place}: '{name}' is ambiguous; expected one of: {', '.join(sorted(found))}")
    raise FraexpError(f"{place}: there is no '{name}' to sort by{did_you_mean(name, [*fields, *headings])}")
