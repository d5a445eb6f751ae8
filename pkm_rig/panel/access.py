"""Who may see the page: one-time tokens, a session's cookie, and requests that come from the page itself.

An ASGI application around the page's own. Whatever reaches that one, HTTP or WebSocket, has named a host that is ours,
comes from our own origin and carries the cookie of a session that a token has begun.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

from pkm_rig.panel.login_page import LOGIN_PAGE, LOGIN_POLICY

MOST_SESSIONS = 20
MOST_LOGIN_BYTES = 1024
MOST_BODY_BYTES = 1_200_000  # an upload of a megabyte with what surrounds it
TOKEN_BYTES = 24
PAGE_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; object-src 'none'; base-uri 'self'; "
    "form-action 'self'; frame-ancestors 'none'"
)  # of NiceGUI, whose templates are compiled in the browser; no request can leave for another host

Scope = Mapping[str, Any]
Send = Callable[[Any], Any]
Receive = Callable[[], Any]


@dataclass(frozen=True)
class Address:
    """Where the page is served; `names` are the hosts by which a browser may ask for it, loopback's by default."""

    port: int
    names: tuple[str, ...] = ("127.0.0.1", "localhost", "[::1]")
    tls: bool = False

    @property
    def hosts(self) -> frozenset[str]:
        """Values of the header Host that are ours."""
        usual = 443 if self.tls else 80
        return frozenset(f"{name}:{self.port}" for name in self.names) | (
            frozenset(self.names) if self.port == usual else frozenset()
        )

    @property
    def origins(self) -> frozenset[str]:
        """Values of the header Origin that are ours."""
        return frozenset(f"{'https' if self.tls else 'http'}://{host}" for host in self.hosts)

    @property
    def url(self) -> str:
        """What is typed into a browser."""
        return f"{'https' if self.tls else 'http'}://{self.names[0]}:{self.port}/"


class Tokens:
    """One token at a time, good for one login; sessions that it has begun. Only digests are kept.

    `announce` gets each new token, to be shown where only the operator sees it.
    """

    def __init__(self, announce: Callable[[str], None]) -> None:
        self._announce = announce
        self._lock = threading.Lock()
        self._token = b""
        self._sessions: list[bytes] = []

    def begin_session(self, token: str) -> str | None:
        """A new session's secret for the token, which is good no more; None for any other text."""
        with self._lock:
            if not hmac.compare_digest(_digest(token), self._token):
                return None
            self._token = b""
            secret = secrets.token_urlsafe(32)
            self._sessions = [*self._sessions[1 - MOST_SESSIONS :], _digest(secret)]
        self.renew()
        return secret

    def is_session(self, secret: str) -> bool:
        """Whether a session has this secret; all are compared, however early one fits."""
        with self._lock:
            digest = _digest(secret)
            return sum(hmac.compare_digest(digest, known) for known in self._sessions) > 0

    def end_session(self, secret: str) -> None:
        """Let a session's secret be good no more."""
        with self._lock:
            self._sessions = [known for known in self._sessions if not hmac.compare_digest(known, _digest(secret))]

    def renew(self) -> None:
        """Announce a new token; the one before is good no more. Before the first nobody can log in."""
        token = secrets.token_urlsafe(TOKEN_BYTES)
        with self._lock:
            self._token = _digest(token)
        self._announce(token)


def _digest(secret: str) -> bytes:
    return hashlib.sha256(secret.encode("utf-8", "surrogatepass")).digest()


class Guarded:
    """The page's application behind the checks of this module."""

    def __init__(self, application: Callable[..., Any], address: Address, tokens: Tokens) -> None:
        self._application, self._address, self._tokens = application, address, tokens
        self._cookie = f"{'__Host-' if address.tls else ''}pkm-rig-panel-{address.port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one connection."""
        if scope["type"] not in ("http", "websocket"):
            await self._application(scope, receive, send)
            return
        problem = self._problem(scope)
        if problem is not None:
            await _refuse(scope, receive, send, *problem)
        elif scope["type"] == "http" and scope["path"] == "/login":
            await self._login(scope, receive, send)
        elif not self._tokens.is_session(self._secret(scope)):
            if scope["type"] == "http" and scope["method"] == "GET" and b"text/html" in _header(scope, b"accept"):
                await _answer(send, 303, headers=[(b"location", b"/login")])
            else:
                await _refuse(scope, receive, send, 401, "log in first")
        elif scope["type"] == "http" and scope["path"] == "/logout" and scope["method"] == "POST":
            self._tokens.end_session(self._secret(scope))
            await _answer(send, 303, headers=[(b"location", b"/login"), self._set_cookie("", "; Max-Age=0")])
        else:
            await self._application(scope, _bounded(receive), _with_headers(send))

    def _problem(self, scope: Scope) -> tuple[int, str] | None:
        """Why a request is not the page's own, if it is not."""
        hosts = [value for name, value in scope["headers"] if name == b"host"]
        if len(hosts) != 1 or hosts[0].decode("latin-1").lower() not in self._address.hosts:
            return 421, "this host is not served here"
        origins = [value for name, value in scope["headers"] if name == b"origin"]
        must = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")
        ours = [origin.decode("latin-1").lower() in self._address.origins for origin in origins]
        if not all(ours) or len(ours) > 1 or (must and not ours):
            return 403, "not from this page"
        if _header(scope, b"sec-fetch-site") == b"cross-site" and _header(scope, b"sec-fetch-mode") != b"navigate":
            return 403, "not from this page"
        if "token" in parse_qs(scope["query_string"].decode("latin-1"), keep_blank_values=True):
            return 400, "a token must not stand in an address; it is typed into the page"
        length = _header(scope, b"content-length") or b"0"
        if not length.isdigit() or int(length) > MOST_BODY_BYTES:
            return 413, "too large"
        return None

    def _secret(self, scope: Scope) -> str:
        try:
            cookies = SimpleCookie(_header(scope, b"cookie").decode("latin-1"))
        except CookieError:
            return ""
        return cookies[self._cookie].value if self._cookie in cookies else ""

    def _set_cookie(self, secret: str, more: str = "") -> tuple[bytes, bytes]:
        secure = "; Secure" if self._address.tls else ""
        text = f"{self._cookie}={secret}; Path=/; HttpOnly; SameSite=Strict{secure}{more}"
        return b"set-cookie", text.encode("latin-1")

    async def _login(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["method"] == "GET":
            await _answer(send, 200, LOGIN_PAGE.encode(), policy=LOGIN_POLICY)
            return
        body = b""
        while scope["method"] == "POST":
            message = await receive()
            body += message.get("body", b"")
            if not message.get("more_body") or len(body) > MOST_LOGIN_BYTES:
                break
        fields = parse_qs(body[:MOST_LOGIN_BYTES].decode("utf-8", "replace"), max_num_fields=4)
        secret = self._tokens.begin_session(fields.get("token", [""])[0].strip())
        if secret is None:
            page = LOGIN_PAGE.replace("<!-- said -->", "<p role=alert>Not the present token. It is good once.</p>")
            await _answer(send, 403, page.encode(), policy=LOGIN_POLICY)
            return
        await _answer(send, 303, headers=[(b"location", b"/"), self._set_cookie(secret)])


def _header(scope: Scope, name: bytes) -> bytes:
    return next((bytes(value) for key, value in scope["headers"] if key == name), b"")


def _headers(policy: str) -> list[tuple[bytes, bytes]]:
    return [
        (b"content-security-policy", policy.encode("latin-1")),
        (b"x-content-type-options", b"nosniff"),
        (b"x-frame-options", b"DENY"),
        (b"referrer-policy", b"same-origin"),  # with none at all browsers send the origin "null"
        (b"cross-origin-opener-policy", b"same-origin"),
        (b"cross-origin-resource-policy", b"same-origin"),
    ]


def _with_headers(send: Send) -> Send:
    async def send_with_headers(message: Any) -> None:
        if message["type"] == "http.response.start":
            there = [(name, value) for name, value in message["headers"]]
            names = {bytes(name).lower() for name, _ in there}
            more = [entry for entry in _headers(PAGE_POLICY) if entry[0] not in names]
            if b"cache-control" not in names:
                more.append((b"cache-control", b"no-store"))
            message = {**message, "headers": [*there, *more]}
        await send(message)

    return send_with_headers


def _bounded(receive: Receive) -> Receive:
    """Requests whose length is not stated end where a stated one would have been refused."""
    taken = 0

    async def receive_bounded() -> Any:
        nonlocal taken
        message = await receive()
        if message["type"] == "http.request":
            taken += len(message.get("body", b""))
            if taken > MOST_BODY_BYTES:
                return {"type": "http.disconnect"}
        return message

    return receive_bounded


async def _answer(
    send: Send,
    status: int,
    body: bytes = b"",
    *,
    headers: list[tuple[bytes, bytes]] | None = None,
    policy: str = "default-src 'none'; frame-ancestors 'none'",
) -> None:
    kind = b"text/html; charset=utf-8" if body.startswith(b"<!doctype") else b"text/plain; charset=utf-8"
    all_headers = [
        *_headers(policy), *(headers or []), (b"content-type", kind), (b"cache-control", b"no-store"),
        (b"content-length", str(len(body)).encode()),
    ]  # fmt: skip
    await send({"type": "http.response.start", "status": status, "headers": all_headers})
    await send({"type": "http.response.body", "body": body})


async def _refuse(scope: Scope, receive: Receive, send: Send, status: int, text: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008, "reason": text})
        return
    await _answer(send, status, text.encode())
