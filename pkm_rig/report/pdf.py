"""A page as PDF in A4, by WeasyPrint (extra `[pdf]`); it requests nothing from anywhere."""

from __future__ import annotations

import importlib.util
import logging
from pathlib import Path
from typing import Any

from calibration.base.errors import InputError

MISSING = "a PDF needs WeasyPrint; install it with: pip install 'pkm-rig[pdf]'"


def require_pdf() -> None:
    """InputError where WeasyPrint, or a library of the system that it needs, is missing."""
    if importlib.util.find_spec("weasyprint") is None:
        raise InputError(f"--pdf: {MISSING}")
    try:
        _weasyprint()
    except OSError as error:
        raise InputError(
            f"--pdf: WeasyPrint lacks a library of the system ({str(error).splitlines()[0][:120]}); install Pango, "
            "on Debian libpango-1.0-0 and libpangoft2-1.0-0"
        ) from error


def write_pdf(html: str, path: Path) -> None:
    """Write a page as PDF. Raises OSError."""
    path.write_bytes(pdf_of(html))


def pdf_of(html: str) -> bytes:
    """A page as PDF; whatever it names outside itself is left out, and not asked for."""
    weasyprint = _weasyprint()
    embedded_only = weasyprint.urls.URLFetcher(allowed_protocols=("data",), allow_redirects=False)
    document: bytes = weasyprint.HTML(string=html, url_fetcher=embedded_only).write_pdf()
    return document


def _weasyprint() -> Any:
    import weasyprint  # noqa: PLC0415  # an extra, and slow to import

    logging.getLogger("weasyprint").addHandler(logging.NullHandler())
    return weasyprint
