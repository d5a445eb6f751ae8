"""What a program says of a recording: one JSON object, read strictly (docs/how-to/enter-gapbench.md)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NoReturn

from benchmarks.withheld.scorer import NONE, UNKNOWN
from mock_devices.effects import CATALOGUE

NAMES = (*CATALOGUE, NONE, UNKNOWN)
SUM_WITHIN = 1e-3
PAGE = "docs/how-to/enter-gapbench.md"
_QUOTED = 40  # letters of what was printed, in a message


class NotAnAnswer(ValueError):
    """What was printed is no answer; one line: what is wrong, where, and what to do."""


@dataclass(frozen=True)
class Answer:
    """A verdict, probabilities of names that add up to 1, and the stated shrink of the gap or None."""

    verdict: str
    ranking: Mapping[str, float]
    shrink: float | None


def read_answer(text: str) -> Answer:
    """The answer that a program printed; further keys are passed over. Raises NotAnAnswer."""
    data = _object(text)
    verdict = data.get("verdict")
    if not isinstance(verdict, str) or verdict not in NAMES:
        raise NotAnAnswer(
            f"verdict: {_short(verdict)} is no name of an effect, none or unknown; the names are in {PAGE}"
        )
    ranking = _ranking(data.get("ranking"))
    if verdict not in ranking:
        raise NotAnAnswer(f"ranking: the verdict '{verdict}' is not in it; give its probability")
    return Answer(verdict, ranking, _shrink(data))


def _object(text: str) -> dict[str, Any]:
    if not text.strip():
        raise NotAnAnswer("nothing was printed; print one JSON object on standard output")
    try:
        data = json.loads(text, object_pairs_hook=_once, parse_constant=_refuse)
    except NotAnAnswer:
        raise
    except json.JSONDecodeError as error:
        if error.msg == "Extra data":
            raise NotAnAnswer(
                f"line {error.lineno}: something follows the JSON object; print it alone, the rest on standard error"
            ) from None
        raise NotAnAnswer(
            f"line {error.lineno}, column {error.colno}: no JSON ({error.msg.lower()}) in {_short(text)}; "
            "print one JSON object and nothing else"
        ) from None
    except (RecursionError, ValueError):  # nested, or whole numbers with more digits than Python reads
        raise NotAnAnswer(f"no JSON that can be read in {_short(text)}; print one plain JSON object") from None
    if not isinstance(data, dict):
        raise NotAnAnswer(f"{_short(data)} is no JSON object; print one with verdict and ranking")
    return data


def _ranking(ranking: Any) -> dict[str, float]:
    if not isinstance(ranking, dict) or not ranking:
        raise NotAnAnswer(f"ranking: {_short(ranking)} is no object of names and probabilities; see {PAGE}")
    out = {}
    for name, p in ranking.items():
        if name not in NAMES:
            raise NotAnAnswer(
                f"ranking: {_short(name)} is no name of an effect, none or unknown; the names are in {PAGE}"
            )
        if not _is_number(p) or not 0.0 <= p <= 1.0:
            raise NotAnAnswer(f"ranking: the probability of '{name}' is {_short(p)}; give a number from 0 to 1")
        out[name] = float(p)
    if abs(sum(out.values()) - 1.0) > SUM_WITHIN:
        raise NotAnAnswer(
            f"ranking: the probabilities add up to {sum(out.values()):.6g}, not 1; leave no name out, or divide by that"
        )
    return out


def _shrink(data: dict[str, Any]) -> float | None:
    gap = data.get("gap")
    # `pkm-rig diagnose --json` has it there.
    shrink = gap.get("shrink") if "shrink" not in data and isinstance(gap, dict) else data.get("shrink")
    if shrink is None:
        return None
    if not _is_number(shrink) or not -1e9 < shrink <= 1.0:
        raise NotAnAnswer(f"shrink: {_short(shrink)}; give the share of the gap that is explained, at most 1, or null")
    return float(shrink)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for name, value in pairs:
        if name in out:
            raise NotAnAnswer(f"the key {_short(name)} is there more than once; give it once")
        out[name] = value
    return out


def _refuse(constant: str) -> NoReturn:
    raise NotAnAnswer(f"{constant} is no JSON number; give a finite one, or null for a shrink that there is none of")


def _short(value: Any) -> str:
    text = value if isinstance(value, str) else repr(value)
    return repr(text if len(text) <= _QUOTED else f"{text[:_QUOTED]} ...")
