"""Names that other languages take: letters, digits and underscores, none of them reserved."""

import re
from collections.abc import Collection, Iterable

_C_TEXT = """
    auto break case char const continue default do double else enum extern float for goto if inline int long register
    restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
    main self exp expm1 log sqrt sin cos tan asin acos atan tanh copysign pow fabs real y0 y1 yn j0 j1 jn gamma
    class new delete this template private public operator try catch bool true false and or not xor
"""
C_WORDS = frozenset(_C_TEXT.split())
"""Reserved words of C and C++, and names of <tgmath.h>."""
_ST_TEXT = """
    abs acos action add adr and any array asin at atan begin bool by byte case concat configuration constant cos date
    delete dint div do dt dword else elsif end eq exit exp expt false find for from function ge global gt if in
    input insert int interface interval jmp le left len limit lint ln log lower_bound lreal lt lword max method mid
    min mod move mul mux ne not of on or output pointer priority program property r_edge f_edge read_only read_write
    real ref reference repeat replace resource ret retain return right rol ror rs s sel shl shr sin sint single
    sizeof sqrt sr step string struct sub super tan task then this time to tod transition trunc true type udint
    uint ulint until upper_bound usint var wait while with word wstring xor r ld st n p l d c t q e continue
"""
ST_WORDS = frozenset(_ST_TEXT.split())
"""Reserved words, standard functions and edge names of IEC 61131-3 and its dialects."""


def safe_names(names: Iterable[str], reserved: Collection[str], ignore_case: bool) -> dict[str, str]:
    """Return a name for each name that a language takes, all of them different."""
    found: dict[str, str] = {}
    taken: set[str] = set()
    for name in names:
        plain = "".join(c if c.isascii() else f"u{ord(c):x}" for c in name)
        plain = re.sub(r"_+", "_", plain).strip("_") or "unused"
        if plain.lower() in reserved or plain[0].isdigit():
            plain = f"v_{plain}"
        options = (plain, *(f"{plain}_{k}" for k in range(2, 10_000)))
        unique = next(each for each in options if (each.lower() if ignore_case else each) not in taken)
        taken.add(unique.lower() if ignore_case else unique)
        found[name] = unique
    return found
