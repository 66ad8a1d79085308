"""Words that strangers wrote, as one spelling: keys and names are told apart by letters and digits alone."""

from __future__ import annotations

import re
import unicodedata

CYRILLIC = "авгԁеіјклмнопрԛѕстуԝхһӏ", "abrdeijklmhonpqsctywxhl"
GREEK = "αβγδεηικλμνορσςτυχω", "abydenikmmvopsstuxw"
OTHER = "ıɑɡɩ", "iagi"
LATIN_LIKE = str.maketrans(*("".join(part) for part in zip(CYRILLIC, GREEK, OTHER, strict=True)))
"""Small letters of other alphabets that look like Latin ones, or stand for them in formulas."""


def plain(word: str) -> str:
    """A key or a name in lower-case Latin letters and digits alone: capitals, blanks, marks, accents, wide
    letters, and those of other alphabets that look the same make no difference."""
    letters = unicodedata.normalize("NFKD", word).casefold().translate(LATIN_LIKE)
    return re.sub(r"[^a-z0-9]", "", letters)


def is_foreign(word: str) -> bool:
    """Whether a word holds letters of which `plain` leaves nothing: nobody here knows what it says."""
    return any(unicodedata.category(letter)[0] in "LNC" and not plain(letter) for letter in word)
