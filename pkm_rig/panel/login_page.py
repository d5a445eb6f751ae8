"""The only page without a session: a token is typed into it, or follows the # of its address, which no server sees."""

from __future__ import annotations

import base64
import hashlib

_SCRIPT = """
const given = location.hash.slice(1);
if (given) {
  history.replaceState(null, "", location.pathname);
  document.getElementById("token").value = given;
  document.forms[0].submit();
}
"""
_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 26rem; margin: 12vh auto; padding: 0 1rem; color: #1d2733 }
input, button { font: inherit; width: 100%; box-sizing: border-box; padding: .6rem; margin: .4rem 0 }
button { background: #2a6f97; color: #fff; border: 0; border-radius: .3rem }
[role=alert] { color: #b0413e }
"""
LOGIN_PAGE = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>pkm-rig panel</title><style>{_STYLE}</style></head>
<body><h1>pkm-rig panel</h1>
<!-- said -->
<form method="post" action="/login" autocomplete="off">
<label for="token">Token, as the terminal shows it that has started the panel</label>
<input id="token" name="token" type="password" required maxlength="200" autofocus autocomplete="off">
<button>Enter</button></form>
<p>Each token is good for one browser; the terminal then shows the next.</p>
<script>{_SCRIPT}</script></body></html>
"""


def _hash(text: str) -> str:
    return "'sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() + "'"


LOGIN_POLICY = (
    f"default-src 'none'; script-src {_hash(_SCRIPT)}; style-src {_hash(_STYLE)}; form-action 'self'; "
    "base-uri 'none'; frame-ancestors 'none'"
)
