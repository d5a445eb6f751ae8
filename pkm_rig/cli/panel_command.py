"""The command that serves the page."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Annotated

import typer

from pkm_rig.cli.options import OutOption, RigOption


def panel(
    rig: RigOption,
    out: OutOption = Path("runs"),
    host: Annotated[str, typer.Option(help="of this computer; beyond loopback only with TLS")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0: a free one")] = 8765,
    certificate: Annotated[Path | None, typer.Option(help="TLS: the page's certificate, PEM")] = None,
    key: Annotated[Path | None, typer.Option(help="TLS: its key, PEM")] = None,
) -> None:
    """Serve the page that guides through a calibration in a browser, until interrupted."""
    from pkm_rig.jobs.session import open_rig
    from pkm_rig.panel.server import Place, require_nicegui, require_place, serving
    from pkm_rig.report.terminal import messages

    place = Place(host, port, certificate, key)
    require_place(place)
    require_nicegui()
    from pkm_rig.panel.access import Address
    from pkm_rig.panel.work import Work

    work = Work(rig, out, open_rig)

    def announce(address: Address, token: str) -> None:
        messages.print(f"panel: {address.url}login#{token}", soft_wrap=True)
        messages.print(f"       or {address.url} with token {token} (good once)", soft_wrap=True)

    try:
        with serving(work, place, announce):
            threading.Event().wait()
    finally:
        work.close()
