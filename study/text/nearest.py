"""The known name nearest to one that a user misspelt, and the words that offer it."""

import difflib
from collections.abc import Iterable


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The known name most like an unknown one, or the only one that begins with it; None if there is neither.

    Capitals count as small letters.
    """
    small = {each.casefold(): each for each in known}
    name = name.casefold()
    longer = [each for each in small if name and each.startswith(name)]
    close = difflib.get_close_matches(name, list(small), n=1) or (longer if len(longer) == 1 else [])
    return small[close[0]] if close else None


def did_you_mean(names: str | Iterable[str], known: Iterable[str]) -> str:
    """The remedy for an unknown name, as the end of a message.

    Args:
        names: the unknown name, or several.
        known: the names that are known, in the order in which to list them.

    Returns:
        "did you mean 'kasa'? Known are kasa, lls"; without a name that is much like it, "known are kasa, lls".
    """
    known = list(known)
    found = [nearest(name, known) for name in ([names] if isinstance(names, str) else names)]
    close = list(dict.fromkeys(name for name in found if name is not None))
    listed = f"nown are {', '.join(known)}"
    return f"did you mean {' and '.join(map(repr, close))}? K{listed}" if close else f"k{listed}"
