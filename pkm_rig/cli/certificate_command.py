"""The command that writes and checks certificates."""

from __future__ import annotations

import getpass
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibration.base.errors import InputError
from pkm_rig.cli.options import JsonOption, OutOption, campaigns, rig_path
from pkm_rig.errors import CampaignRefused

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import AbstractContextManager

    from rich.console import RenderableType

    from pkm_rig.certificate.content import Change
    from pkm_rig.certificate.keys import SigningKey


def certificate(
    campaign: Annotated[
        str | None, typer.Argument(help="verified campaign in the store", autocompletion=campaigns)
    ] = None,
    rig: Annotated[
        Path | None,
        typer.Option(parser=rig_path, metavar="RIG.toml", help="its sections on certificates, not the stored ones"),
    ] = None,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    dcc: Annotated[str, typer.Option(help="version of the Digital Calibration Certificate: 3.3.0 or 3.0.0")] = "3.3.0",
    schemas: Annotated[Path | None, typer.Option(help="folder of its schema files; without it not checked")] = None,
    pdf: Annotated[bool, typer.Option("--pdf", help="its page as PDF too, in A4 (needs the extra [pdf])")] = False,
    key: Annotated[Path | None, typer.Option(help="sign with this key (PEM); its passphrase is asked for")] = None,
    pkcs11: Annotated[Path | None, typer.Option(help="sign with a token: library of its maker")] = None,
    token: Annotated[str | None, typer.Option(help="label of the token; its PIN is asked for")] = None,
    key_label: Annotated[str | None, typer.Option(help="label of the key on the token")] = None,
    signer: Annotated[
        Path | None, typer.Option(help="the signer's certificate (PEM): to sign with, or to check against")
    ] = None,
    amends: Annotated[str | None, typer.Option(help="number of the certificate that this one amends")] = None,
    substitutes: Annotated[str | None, typer.Option(help="number of the certificate that this one replaces")] = None,
    why: Annotated[str | None, typer.Option(help="why it is amended or replaced")] = None,
    check: Annotated[Path | None, typer.Option(help="check this certificate, with --signer or --ca")] = None,
    ca: Annotated[Path | None, typer.Option(help="certificates (PEM) that may have issued the signer's")] = None,
) -> None:
    """Write a campaign's Digital Calibration Certificate (XML) and its page, or check one (--check FILE)."""
    if check is not None:
        if campaign is not None or key is not None or pkcs11 is not None:
            raise InputError("certificate: --check takes a file and --signer or --ca, nothing else")
        _check(check, signer, ca, json)
        return
    if campaign is None:
        raise InputError("certificate: of which campaign? `pkm-rig list` shows what is there")
    if ca is not None or (signer is not None and key is None and pkcs11 is None):
        raise InputError("certificate: --signer goes with --key or --pkcs11, --ca with --check")
    from pkm_rig.jobs.certificate import Wanted, issue, parse_version
    from pkm_rig.report.pdf import require_pdf, write_pdf
    from pkm_rig.report.terminal import print_result
    from pkm_rig.rig.config import load_rig
    from pkm_rig.store.store import hold_existing_store

    if pdf:
        require_pdf()

    wanted = Wanted(
        version=parse_version(dcc),
        schemas=schemas,
        key=_key(key, pkcs11, token, key_label, signer),
        replaces=_replaces(amends, substitutes, why),
    )
    rig_file = None if rig is None else load_rig(rig)[0]
    with hold_existing_store(out, campaign=campaign) as store:
        result = issue(store, campaign, out, wanted, rig_file)
    page = Path(result["page"])
    if pdf:
        write_pdf(page.read_text(encoding="utf-8"), page.with_suffix(".pdf"))
    result |= {"pdf": str(page.with_suffix(".pdf")) if pdf else None}
    print_result(
        json,
        result,
        f"certificate {result['number']}: {result['certificate']}",
        f"schema: {result['schema']}; rules: {result['rules']}; {'signed' if result['signed'] else 'not signed'}; "
        f"{'traceable' if result['traceable'] else 'not traceable'}",
        f"page: {result['pdf'] or result['page']}",
    )


def _replaces(amends: str | None, substitutes: str | None, why: str | None) -> tuple[Change, str, str] | None:
    if amends is None and substitutes is None:
        if why is not None:
            raise InputError("certificate: --why goes with --amends or --substitutes")
        return None
    if (amends is not None and substitutes is not None) or not why or not why.strip():
        raise InputError("certificate: give --amends or --substitutes, and --why with the reason")
    return ("amended", amends, why) if amends is not None else ("substituted", str(substitutes), why)


def _key(
    key: Path | None, pkcs11: Path | None, token: str | None, key_label: str | None, signer: Path | None
) -> Callable[[], AbstractContextManager[SigningKey]] | None:
    """Opens the key that was named; None where the certificate is not to be signed."""
    if key is None and pkcs11 is None:
        return None
    if signer is None or (key is not None and pkcs11 is not None):
        raise InputError("certificate: to sign give --signer CERT.pem, and --key or --pkcs11")
    from pkm_rig.certificate.keys import load_key, token_key

    if key is not None:
        path = key
        return lambda: nullcontext(load_key(path, signer, getpass.getpass))
    if pkcs11 is None or token is None or key_label is None:
        raise InputError("certificate: --pkcs11 needs --token and --key-label")
    return lambda: token_key(pkcs11, token, key_label, signer, getpass.getpass)


def _check(file: Path, signer: Path | None, ca: Path | None, json: bool) -> None:
    """Say whether a certificate is as it was signed; status 1 where it is not, or the signer was not checked."""
    from pkm_rig.certificate.page import quantities_of
    from pkm_rig.certificate.verification import NotIntact, check
    from pkm_rig.certificate.xml_form import DCC, read_bytes
    from pkm_rig.report.terminal import print_result

    if signer is not None and ca is not None:
        raise InputError("certificate: give --signer or --ca, not both")
    try:
        checked = check(read_bytes(file), str(file), signer=signer, ca=ca)
    except NotIntact as error:
        raise CampaignRefused(str(error)) from error
    number = checked.root.findtext(f".//{{{DCC}}}uniqueIdentifier")
    said = "intact, signed by" if checked.trusted else "intact, signer not checked:"
    print_result(
        json,
        {
            "certificate": number,
            "intact": True,
            "signer": checked.signer,
            "signer_checked": checked.trusted,
            "quantities": quantities_of(checked.root),
        },
        f"{number}: {said} {checked.signer}",
        *([_results(quantities_of(checked.root))] if checked.trusted else []),
    )
    if not checked.trusted:
        raise CampaignRefused("the signer was not checked; give --signer CERT.pem or --ca CA.pem")


def _results(quantities: list[dict[str, str | None]]) -> RenderableType:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    table.add_column("")
    for head in ("value", "U", "k"):
        table.add_column(head, justify="right")
    table.add_column("unit")
    for q in quantities:
        table.add_row(*(q[key] or "" for key in ("name", "value", "expanded", "k", "shown_unit")))
    return table
