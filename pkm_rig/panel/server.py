"""Serves the page: NiceGUI behind the checks of `access`, on this computer only unless TLS is given."""

from __future__ import annotations

import os
import socket
import ssl
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path

from calibration.base.errors import InputError
from pkm_rig.panel.access import Address, Guarded, Tokens
from pkm_rig.panel.files import picture_of, report_of
from pkm_rig.panel.work import Work

REPORT_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; sandbox allow-same-origin"
LOOPBACK = ("127.0.0.1", "localhost", "::1")
START_S = 30.0
MISSING = "panel: NiceGUI is not installed; install it with: pip install 'pkm-rig[ui]'"


@dataclass(frozen=True)
class Place:
    """Where to serve: a host of this computer, a port (0: a free one), and certificate and key for TLS."""

    host: str = "127.0.0.1"
    port: int = 8765
    certificate: Path | None = None
    key: Path | None = None


def require_place(place: Place) -> None:
    """Raise InputError for a host beyond loopback without TLS, for any host at all, and for files that do not fit."""
    if (place.certificate is None) != (place.key is None):
        raise InputError("panel: TLS needs both --certificate and --key")
    if place.host not in LOOPBACK and place.certificate is None:
        raise InputError(
            f"panel: {place.host} is not this computer's loopback, where the page is served only over TLS; "
            "give --certificate and --key"
        )
    if _is_every_address(place.host):
        raise InputError(f"panel: {place.host} is every address; name the one by which browsers ask for the page")
    if place.certificate is not None and place.key is not None:
        try:
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(place.certificate, place.key)
        except (OSError, ssl.SSLError) as error:
            raise InputError(f"panel: certificate {place.certificate} and key {place.key}: {error}") from error


def _is_every_address(host: str) -> bool:
    try:
        return ip_address(host).is_unspecified
    except ValueError:  # a name
        return False


def require_nicegui() -> None:
    """Raise InputError, in one line, where the extra is not installed."""
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str(Path(tempfile.gettempdir()) / "pkm-rig-panel"))  # nothing is kept
    os.environ.setdefault("MATPLOTLIB", "false")
    try:
        import nicegui  # noqa: F401, PLC0415
        import uvicorn  # noqa: F401, PLC0415
    except ImportError as error:
        raise InputError(MISSING) from error


@contextmanager
def serving(work: Work, place: Place, announce: Callable[[Address, str], None]) -> Iterator[Address]:
    """Serve the page in a thread of its own; one panel a process.

    `announce` gets the address and each new token, to be shown where only the operator sees it. The work goes on when
    serving ends. Raises InputError.
    """
    require_place(place)
    require_nicegui()
    import uvicorn  # noqa: PLC0415

    listener = _listen(place)
    port = int(listener.getsockname()[1])
    tls = place.certificate is not None
    address = Address(port, tls=tls) if place.host in LOOPBACK else Address(port, (place.host,), tls)
    tokens = Tokens(lambda token: announce(address, token))
    config = uvicorn.Config(
        Guarded(_application(work, address), address, tokens),
        access_log=False,
        log_level="critical",
        lifespan="on",
        ws_max_size=1_000_000,
        ssl_certfile=place.certificate,
        ssl_keyfile=place.key,
        timeout_graceful_shutdown=2,
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, name="panel-server", daemon=True)
    thread.start()
    end_s = time.monotonic() + START_S
    while not server.started:
        if not thread.is_alive() or time.monotonic() > end_s:
            raise InputError(f"panel: it cannot be served at {address.url}")
        time.sleep(0.02)
    tokens.renew()
    try:
        yield address
    finally:
        server.should_exit = True
        thread.join(timeout=10.0)


def _listen(place: Place) -> socket.socket:
    try:
        family = socket.getaddrinfo(place.host, place.port, type=socket.SOCK_STREAM)[0]
        listener = socket.socket(family[0], socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(family[4])
    except OSError as error:
        raise InputError(f"panel: {place.host}:{place.port}: {error.strerror}; choose another --port") from error
    return listener


def _application(work: Work, address: Address) -> Callable[..., object]:
    from fastapi.responses import FileResponse, PlainTextResponse, Response  # noqa: PLC0415
    from nicegui import app as application  # noqa: PLC0415
    from nicegui import core, ui  # noqa: PLC0415
    from nicegui.middlewares import SetCacheControlMiddleware  # noqa: PLC0415

    from pkm_rig.panel.page import Page  # noqa: PLC0415

    style = Path(__file__).with_name("style.css").read_text(encoding="utf-8")

    @application.get("/campaign/{campaign}/report")
    def report(campaign: str) -> Response:
        path = report_of(work.out, campaign)
        if path is None:
            return PlainTextResponse("there is no such report", status_code=404)
        return FileResponse(path, media_type="text/html", headers={"content-security-policy": REPORT_POLICY})

    @application.get("/campaign/{campaign}/picture/{name}")
    def picture(campaign: str, name: str) -> Response:
        path = picture_of(work.out, campaign, name)
        if path is None:
            return PlainTextResponse("there is no such picture", status_code=404)
        return FileResponse(path, media_type="image/png", headers={"cache-control": "no-store"})

    @ui.page("/", title=f"{work.file.rig} - pkm-rig panel")
    def page() -> None:
        ui.add_css(style)
        ui.colors(primary="#2a6f97", negative="#b0413e")
        Page(work, time.monotonic)

    application.config.add_run_config(  # what `ui.run` does, which would have a server and signal handlers of its own
        reload=False,
        title="pkm-rig panel",
        viewport="width=device-width, initial-scale=1",
        favicon="⚙",
        dark=False,
        language=None,
        binding_refresh_interval=None,
        reconnect_timeout=5.0,
        message_history_length=1000,
        tailwind=False,
        unocss=None,
        prod_js=True,
        show_welcome_message=False,
        markdown=False,
    )
    application.add_middleware(SetCacheControlMiddleware)
    core.sio.eio.cors_allowed_origins = sorted(address.origins)  # any, by default; checked by `Guarded` already
    return application
