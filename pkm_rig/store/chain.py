"""The hash chain over a campaign: each row's value is the SHA-256 of the value before it and the row's content.

Content is what a row says, not how its table stores it, so that a migration keeps it (docs/decisions/0010-record.md).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any


def canonical(value: object) -> str:
    """JSON in the one form that chained rows are stored in: sorted keys, shortest exact float64, ASCII.

    Raises ValueError for NaN and infinities.
    """
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def genesis(campaign: str, created: str, description: Mapping[str, Any], machine: str) -> str:
    """The value before the first row, of the campaign itself."""
    return _digest({"campaign": campaign, "created": created, "description": description, "machine": machine})


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
    event = f'{{"created":{canonical(created)},"data":{data},"kind":{canonical(kind)}}}'
    text = f'{{"after":{canonical(previous)},"campaign":{canonical(campaign)},"event":{event},"position":{position}}}'
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def _digest(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(canonical(content).encode("ascii")).hexdigest()
