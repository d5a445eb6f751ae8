"""A page as PDF: A4, from itself alone; where WeasyPrint is missing, one line says so."""

from __future__ import annotations

import base64
import http.server
import importlib.util
import threading

import pytest

from calibration.base.errors import InputError
from pkm_rig.report import pdf

PIXEL = base64.b64encode(
    bytes.fromhex(
        "89504e470d0a1a0a0000000d4948445200000001000000010806000000"
        "1f15c4890000000d49444154789c6360606060000000050001a5f645400000000049454e44ae426082"
    )
).decode()


def test_without_weasyprint_one_line_names_the_extra(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"pkm-rig\[pdf\]"):
        pdf.require_pdf()


def test_without_a_library_of_the_system_one_line_names_it(monkeypatch):
    pytest.importorskip("weasyprint")

    def missing():
        raise OSError("cannot load library 'libpango-1.0-0'\nand much more")

    monkeypatch.setattr(pdf, "_weasyprint", missing)
    with pytest.raises(InputError, match="libpango") as refused:
        pdf.require_pdf()
    assert len(str(refused.value).splitlines()) == 1


def test_pages_are_a4_and_nothing_is_asked_of_anybody():
    pytest.importorskip("weasyprint")
    pypdfium2 = pytest.importorskip("pypdfium2")
    asked = []

    class Answer(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            self.send_response(404)
            self.end_headers()

        def log_message(self, *_):
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Answer) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        outside = f"http://127.0.0.1:{server.server_port}"
        page = f'<style>@page {{ size: A4 }}</style><p>words</p><img src="data:image/png;base64,{PIXEL}">'
        whole = pdf.pdf_of(page)
        for part in (
            f'<img src="{outside}/a.png">',
            f'<link rel="stylesheet" href="{outside}/b.css">',
            '<img src="file:///etc/passwd">',
        ):
            assert pdf.pdf_of(page + part)
        server.shutdown()
    assert asked == []
    document = pypdfium2.PdfDocument(whole)
    assert [round(side / 72 * 25.4) for side in document[0].get_size()] == [210, 297]
    assert "words" in document[0].get_textpage().get_text_range()
