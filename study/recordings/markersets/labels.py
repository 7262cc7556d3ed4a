"""Labels of markers: how they are compared, their sides, and the points of the body that they stand for.

Laboratories write one label in many ways. It is compared without case, dots, underscores and spaces, and without a
prefix that most labels of a recording have. Points of the body are known by the labels of the common sets.
"""

import re
from collections import Counter
from collections.abc import Iterable, Sequence

_SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}
_STEMS = {
    "asis": "asi asis ias",
    "psis": "psi psis ips",
    "lateral epicondyle": "kne knee lfc fle lepi lek le kneelat",
    "medial epicondyle": "mkne mknee knm mfc fme mepi mek me kneemed",
    "lateral malleolus": "ank ankle lmal fal lm anklelat",
    "medial malleolus": "mankle mank med mma mmal tam mm anklemed",
    "heel": "hee heel cal calc fcc ca",
    "first metatarsal": "mt1 fm1 fmh",
    "fifth metatarsal": "mt5 fm5 vmh d5m 5meta",
    "hip centre": "hjc",
}
"""The points of one side of the body, and their labels in common marker sets, behind the letter of a side."""
_MIDDLE = {"sacrum": "sacr sacrum vsacral"}
LANDMARKS = {
    letter + label: f"{side} {point}"
    for letter, side in (("l", "left"), ("r", "right"))
    for point, labels in _STEMS.items()
    for label in labels.split()
} | {label: point for point, labels in _MIDDLE.items() for label in labels.split()}
"""Points of the body by the `plain` forms of their labels."""


_BONES = "pel|trx|hed|[lr](pel|fe|ti|fo|to|hu|ra|hn|cl)"  # of Plug-in Gait, each with the points o, a, l and p
_QUANTITIES = "angles?|forces?|moments?|powers?|grf|centreofmass|centerofmass|com|progressangles"
_OUTPUT = re.compile(
    rf"^({_BONES})[oalp]$|({_QUANTITIES})(floor)?$|^[lr]?[hkaesw]jc|(joint|hip|knee|ankle)cent(re|er)$"
)


def plain(label: str) -> str:
    """A label as it is compared: small letters and digits alone."""
    return re.sub(r"[\W_]+", "", label).casefold()


def spellings(labels: Sequence[str]) -> dict[str, str]:
    """The labels by their `plain` forms, with and without the prefix that more than half of them have.

    Of two labels with one form the first counts, and a whole label goes before one without its prefix. A side is no
    prefix.
    """
    heads = [(re.match(r"[^\W_]+[\W_]+", label) or [""])[0] for label in labels]
    head, count = Counter(heads).most_common(1)[0] if heads else ("", 0)
    result: dict[str, str] = {}
    for label in labels:
        result.setdefault(plain(label), label)
    if head and 2 * count > len(labels) and plain(head) not in _SIDES:
        for label in labels:
            result.setdefault(plain(label.removeprefix(head)), label)
    return result


def landmarks(labels: Sequence[str]) -> dict[str, str]:
    """The points of the body that labels stand for: the label of each, such as LASI for "left asis".

    Of two labels of one point the one whose form comes first in the table counts. A label may end in ``_study``, as
    OpenCap's do, and that of a hip's centre in the name of a method, as in ``LHJC_reg``.
    """
    spelt = {form.removesuffix("study"): label for form, label in reversed(spellings(labels).items())}
    spelt |= {form[:4]: label for form, label in spelt.items() if re.match("[lr]hjc.", form) and form[:4] not in spelt}
    result: dict[str, str] = {}
    for form, point in LANDMARKS.items():
        if form in spelt:
            result.setdefault(point, spelt[form])
    return result


def is_output(label: str) -> bool:
    """True for the label of what a program computed: angles, forces, centres of joints and of mass, axes of bones."""
    return bool(_OUTPUT.search(plain(label)))


def opposite(one: str, other: str) -> bool:
    """True if two labels begin with the letters of different sides."""
    first, second = (_SIDES.get(plain(label)[:1]) for label in (one, other))
    return None not in (first, second) and first != second


def side_of(labels: Iterable[str]) -> str:
    """The side, left or right, on which all labels begin; "" if they do not agree, or there are none."""
    sides = {_SIDES.get(plain(label)[:1], "") for label in labels}
    return sides.pop() if len(sides) == 1 else ""


_NUMBERED = re.compile(r"(.*[^\W\d_]{2}[\W_]?)(\d+)$")
"""A label of two letters or more and a number."""


def clusters(labels: Sequence[str]) -> list[str]:
    """Groups of three or more labels that differ by a number at the end alone, such as LTH1-LTH3."""
    groups: dict[str, list[tuple[int, str]]] = {}
    for label in labels:
        if (numbered := _NUMBERED.match(label)) is not None:
            groups.setdefault(numbered[1], []).append((int(numbered[2]), label))
    return [f"{min(group)[1]}-{max(group)[1]}" for group in groups.values() if len(group) > 2]


def side(name: str) -> str:
    """Side of the body that a point's name shows: "left", "right", or "" if it shows none."""
    words = name.lower().replace("-", "_").replace(" ", "_").split("_")
    return next((word for word in ("left", "right") if word in words), "")


def mirrored(name: str) -> str:
    """A joint's name on the other side of the body, with its capitals; the same if it tells no side."""
    own = side(name)
    return re.sub(rf"(?<![^_ -])({own})(?![^_ -])", _other_side, name, flags=re.IGNORECASE) if own else name


def _other_side(word: re.Match[str]) -> str:
    found = word[0]
    other = "right" if found.lower() == "left" else "left"
    return other.upper() if found.isupper() else other.capitalize() if found[0].isupper() else other
