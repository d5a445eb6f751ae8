"""What is wrong with something that was given."""

from __future__ import annotations

import re

# Control characters, line and paragraph separators, marks that turn the direction of text, and halves of characters.
_UNPRINTABLE = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufeff]")


def printable(text: str) -> str:
    """A text that no terminal obeys: unprintable characters as \\x1b or \\u202e; line ends too."""
    return _UNPRINTABLE.sub(lambda match: match[0].encode("unicode_escape").decode("ascii"), text)


class InputError(ValueError):
    """An invalid file, measurement or choice: one line that states what is wrong, where, and what to do.

    Names and cells of files stand in it as they were found, but for unprintable characters.
    """

    def __init__(self, line: str) -> None:
        super().__init__(printable(line))
