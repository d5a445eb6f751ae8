"""Requests that reach the page, and those that must not; the application behind is a counter."""

from __future__ import annotations

import asyncio
from urllib.parse import urlencode

import pytest

from pkm_rig.panel.access import Address, Guarded, Tokens

ADDRESS = Address(8765)
HOST, ORIGIN = b"127.0.0.1:8765", b"http://127.0.0.1:8765"


class Behind:
    """The guarded application: counts what reaches it, and reads the body of requests."""

    def __init__(self):
        self.reached = []
        self.took = 0

    async def __call__(self, scope, receive, send):
        self.reached.append(scope["type"])
        if scope["type"] == "websocket":
            await send({"type": "websocket.accept"})
            return
        while (message := await receive())["type"] == "http.request":
            self.took += len(message["body"])
            if not message.get("more_body"):
                break
        await send({"type": "http.response.start", "status": 200, "headers": [(b"content-type", b"text/html")]})
        await send({"type": "http.response.body", "body": b"page"})


class Browser:
    """Sends what it is told to, with the cookie that it has been given."""

    def __init__(self, address=ADDRESS):
        self.tokens, self.behind, self.address = [], Behind(), address
        self.door = Tokens(self.tokens.append)
        self.guarded = Guarded(self.behind, address, self.door)
        self.door.renew()
        self.cookie = None

    def send(self, method, path, headers=(), body=b"", *, kind="http", query=b"", chunks=None):
        headers = list(headers)
        if not any(name == b"host" for name, _ in headers):
            headers.append((b"host", HOST))
        if self.cookie:
            headers.append((b"cookie", self.cookie))
        scope = {"type": kind, "method": method, "path": path, "headers": headers, "query_string": query}
        parts = list(chunks or [body])
        sent = []

        async def receive():
            if kind == "websocket":
                return {"type": "websocket.connect"}
            return {"type": "http.request", "body": parts.pop(0), "more_body": bool(parts)}

        async def send(message):
            sent.append(message)

        asyncio.run(self.guarded(scope, receive, send))
        return sent

    def login(self, token=None):
        body = urlencode({"token": self.tokens[-1] if token is None else token}).encode()
        sent = self.send("POST", "/login", [(b"origin", ORIGIN)], body)
        given = header(sent, b"set-cookie")
        if given:
            self.cookie = given.split(b";")[0]
        return sent


def header(sent, name):
    return dict(sent[0]["headers"]).get(name, b"")


@pytest.fixture
def browser():
    browser = Browser()
    browser.login()
    return browser


def test_a_token_begins_a_session_whose_cookie_no_script_and_no_other_site_can_use(browser):
    cookie = header(Browser().login(), b"set-cookie").decode()
    assert "; HttpOnly" in cookie
    assert "; SameSite=Strict" in cookie
    assert "; Path=/" in cookie
    secure = Browser(Address(8765, ("rig.example",), tls=True))
    sent = secure.send(
        "POST", "/login", [(b"host", b"rig.example:8765"), (b"origin", b"https://rig.example:8765")],
        urlencode({"token": secure.tokens[-1]}).encode(),
    )  # fmt: skip
    assert header(sent, b"set-cookie").startswith(b"__Host-")
    assert b"; Secure" in header(sent, b"set-cookie")
    assert browser.send("GET", "/")[0]["status"] == 200


def test_without_a_session_there_is_the_login_page_only():
    stranger = Browser()
    sent = stranger.send("GET", "/", [(b"accept", b"text/html")])
    assert (sent[0]["status"], header(sent, b"location")) == (303, b"/login")
    assert stranger.send("GET", "/login")[0]["status"] == 200
    assert stranger.send("GET", "/_nicegui/static/x.js")[0]["status"] == 401
    assert stranger.send("POST", "/upload", [(b"origin", ORIGIN)])[0]["status"] == 401
    assert (
        stranger.send("GET", "/_nicegui_ws/", [(b"origin", ORIGIN)], kind="websocket")[0]["type"] == "websocket.close"
    )
    assert stranger.behind.reached == []


def test_a_token_is_good_once_and_a_new_one_is_announced(browser):
    used = browser.tokens[0]
    assert len(browser.tokens) == 2
    again = Browser()
    again.tokens, again.door, again.guarded, again.behind = (
        browser.tokens,
        browser.door,
        browser.guarded,
        browser.behind,
    )
    sent = again.login(used)
    assert sent[0]["status"] == 403
    assert again.cookie is None
    assert again.login(browser.tokens[-1])[0]["status"] == 303


@pytest.mark.parametrize("token", ["", " ", "x" * 5000, "\ud800".encode("utf-8", "surrogatepass").decode("latin-1")])
def test_what_is_no_token_begins_nothing(token):
    stranger = Browser()
    assert stranger.login(token)[0]["status"] == 403
    assert len(stranger.tokens) == 1


def test_before_the_first_token_nobody_can_log_in():
    tokens = Tokens(lambda _token: None)
    assert tokens.begin_session("") is None
    assert not tokens.is_session("")


def test_a_session_that_was_ended_is_replayed_in_vain(browser):
    assert browser.send("POST", "/logout", [(b"origin", ORIGIN)])[0]["status"] == 303
    assert browser.send("GET", "/")[0]["status"] == 401


def test_a_token_in_an_address_is_refused_even_if_it_is_right(browser):
    query = urlencode({"token": browser.tokens[-1]}).encode()
    assert browser.send("GET", "/", query=query)[0]["status"] == 400
    assert len(browser.tokens) == 2  # it is good still, and was not used


@pytest.mark.parametrize(
    "origin",
    [b"http://evil.example", b"null", b"https://127.0.0.1:8765", b"http://127.0.0.1:8766", b"http://127.0.0.1"],
)
def test_a_foreign_origin_reaches_nothing(browser, origin):
    for kind, method in (("http", "POST"), ("http", "GET"), ("websocket", "GET")):
        sent = browser.send(method, "/", [(b"origin", origin)], kind=kind)
        assert sent[0].get("status", sent[0]["type"]) in (403, "websocket.close")
    assert browser.behind.reached == []


def test_a_websocket_and_a_post_name_their_origin(browser):
    assert browser.send("GET", "/", kind="websocket")[0]["type"] == "websocket.close"
    assert browser.send("POST", "/x")[0]["status"] == 403
    assert browser.send("POST", "/x", [(b"origin", ORIGIN), (b"origin", ORIGIN)])[0]["status"] == 403
    assert browser.send("GET", "/", [(b"origin", ORIGIN)], kind="websocket")[0]["type"] == "websocket.accept"


@pytest.mark.parametrize(
    "host", [b"evil.example", b"evil.example:8765", b"127.0.0.1", b"127.0.0.1:80", b"", b"0.0.0.0:8765"]
)
def test_a_rebound_host_reaches_nothing(browser, host):
    assert browser.send("GET", "/", [(b"host", host)])[0]["status"] == 421
    sent = browser.send("GET", "/", [(b"host", host), (b"origin", ORIGIN)], kind="websocket")
    assert sent[0]["type"] == "websocket.close"
    assert browser.behind.reached == []


def test_two_hosts_are_none(browser):
    assert browser.send("GET", "/", [(b"host", HOST), (b"host", HOST)])[0]["status"] == 421


def test_another_site_may_open_the_page_but_load_nothing_of_it(browser):
    cross = (b"sec-fetch-site", b"cross-site")
    assert browser.send("GET", "/", [cross, (b"sec-fetch-mode", b"no-cors")])[0]["status"] == 403
    assert browser.send("GET", "/", [cross, (b"sec-fetch-mode", b"navigate")])[0]["status"] == 200


def test_the_page_may_ask_no_other_host_for_anything(browser):
    policy = header(browser.send("GET", "/"), b"content-security-policy").decode()
    assert "default-src 'self'" in policy
    assert "frame-ancestors 'none'" in policy
    assert "http" not in policy
    assert "*" not in policy


def test_a_body_has_its_bound_whether_it_says_its_length_or_not(browser):
    said = browser.send("POST", "/x", [(b"origin", ORIGIN), (b"content-length", b"99999999")])
    assert said[0]["status"] == 413
    browser.send("POST", "/x", [(b"origin", ORIGIN)], chunks=[b"x" * 400_000] * 10)
    assert browser.behind.took <= 1_200_000


def test_no_length_but_digits(browser):
    assert browser.send("POST", "/x", [(b"origin", ORIGIN), (b"content-length", b"-1")])[0]["status"] == 413
