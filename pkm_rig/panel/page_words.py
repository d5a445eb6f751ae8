"""Messages of jobs in the words of the page: what is to be typed at a terminal becomes what is to be pressed here."""

from __future__ import annotations

import re
from functools import lru_cache

AT_COMPUTER = "at the panel's computer"
PRESSED = tuple(
    (re.compile(pattern), said)
    for pattern, said in (
        (r" and go on with --new-setup", ", then press Go on in a new set-up"),
        (r"go on with --resume\b(?! )", "press Go on with the campaign"),
        (r"go on with `calibrate --resume [^`]*`, or measure a new one, without --resume",
         "press Verify in History, or measure a new one"),
        (r"home the drive \(pkm-rig home --rig RIG\.toml\)", "press Home what lost its reference"),
        (r"`pkm-rig home --rig RIG\.toml --again`", "press Home all drives again"),
        (r"any command that moves the drives switches compensation off, or use `pkm-rig tables`",
         "whatever moves the drives switches compensation off, or press Switch compensation off"),
        (r"switch it off with `pkm-rig tables off`", "press Switch compensation off"),
        (r"`pkm-rig tables(?: show)?` tells", "press Check, which tells"),
        (r"see `pkm-rig tables`", "press Check"),
        (r"see `pkm-rig interim-test`", "press Test the station"),
        (r"`measure` and `identify` work without them", "Measure only works without them"),
        (r"`pkm-rig list` shows what is there", "History shows what is there"),
        (r"see `pkm-rig report [^`]*`", "see its report in History"),
        (r"run `pkm-rig verify` first", "press Verify in History first"),
        (r"`pkm-rig verify`", "press Verify in History"),
        (r"run `pkm-rig calibrate`", "press Calibrate"),
        (r"there is no store in [^;]*; give (?:the )?--out[^;]*", "nothing has been measured here yet"),
        (
            r"(?:choose another|give another folder with|give another|give the|give) --out\b",
            "have the panel started with another folder",
        ),
        (r"(`pkm-rig [a-z][^`]*`)", rf"\1 {AT_COMPUTER}"),  # what has no button
    )
)  # fmt: skip


_OPTION = re.compile(r"(?<![\w-])--[a-z]")


@lru_cache(maxsize=200)  # the same lines are shown again several times a second
def on_page(line: str) -> str:
    """A message with what to press on the page in place of what to type at a terminal.

    What has no button here, of this program or another, is said to be for the panel's computer.
    """
    for pattern, said in PRESSED:
        line = pattern.sub(said, line)
    return f"{line} ({AT_COMPUTER})" if _OPTION.search(line) and AT_COMPUTER not in line else line
