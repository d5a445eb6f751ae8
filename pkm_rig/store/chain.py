"""The hash chain over a campaign: each row's value is the SHA-256 of the value before it and the row's content.

Content is what a row says, not how its table stores it, so that a migration keeps it (docs/decisions/0010-record.md).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from json.encoder import encode_basestring_ascii as _quoted
from typing import Any

_CANONICAL = json.JSONEncoder(sort_keys=True, separators=(",", ":"), allow_nan=False)  # made once: lists need thousands


def canonical(value: object) -> str:
    """JSON in the one form that chained rows are stored in: sorted keys, shortest exact float64, ASCII.

    Raises ValueError for NaN and infinities.
    """
    return _CANONICAL.encode(value)


def genesis(campaign: str, created: str, description: Mapping[str, Any], machine: str) -> str:
    """The value before the first row, of the campaign itself."""
    return _digest({"campaign": campaign, "created": created, "description": description, "machine": machine})


def genesis_of_text(campaign: str, created: str, description: str, machine: str) -> str:
    """The same of a description that is given as the canonical text that it is stored as."""
    head = f'{{"campaign":{_quoted(campaign)},"created":{_quoted(created)},"description":{description}'
    return hashlib.sha256(f'{head},"machine":{_quoted(machine)}}}'.encode("ascii")).hexdigest()


def reading_link(previous: str, campaign: str, position: int, uid: str, sequence: int, data: object) -> str:
    """The chain value of a reading."""
    return _digest(
        {"after": previous, "campaign": campaign, "position": position}
        | {"reading": {"uid": uid, "sequence": sequence, "data": data}}
    )


def event_link(previous: str, campaign: str, position: int, created: str, kind: str, data: object) -> str:
    """The chain value of an event."""
    return _digest(
        {"after": previous, "campaign": campaign, "position": position}
        | {"event": {"created": created, "kind": kind, "data": data}}
    )


def event_link_of_text(previous: str, campaign: str, position: int, created: str, kind: str, data: str) -> str:
    """The same value of an event whose content is given as the canonical text that it is stored as.

    No other row has this value: `created`, `data` and `kind` can be told apart in the text that is digested.
    """
    event = f'{{"created":{_quoted(created)},"data":{data},"kind":{_quoted(kind)}}}'
    text = f'{{"after":{_quoted(previous)},"campaign":{_quoted(campaign)},"event":{event},"position":{position}}}'
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def _digest(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(canonical(content).encode("ascii")).hexdigest()
