"""Headings of cards."""

from __future__ import annotations

from nicegui import ui


def title(text: str) -> None:
    """A heading, as one for programs that read the page aloud too."""
    with ui.element("h2"):
        ui.label(text)
