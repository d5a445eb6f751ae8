"""Signing with the key of a PKCS#11 token: SoftHSM, which is a token in files and keeps its keys as others do."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

pytest.importorskip("signxml")
pytest.importorskip("pkcs11", reason="python-pkcs11, of the extra [certificate], is not installed")

import pkcs11
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from pkcs11.util.ec import decode_ec_private_key
from pkcs11.util.rsa import decode_rsa_private_key

from calibration.base.errors import InputError
from pkm_rig.certificate.keys import token_key
from pkm_rig.certificate.signature import sign
from pkm_rig.certificate.verification import NotIntact, check
from tests.pkm_rig.certificate.certificates import key_and_certificate, pem_files, unsigned

PLACES = (
    "/usr/lib/softhsm/libsofthsm2.so",
    "/usr/lib64/pkcs11/libsofthsm2.so",
    "/usr/local/lib/softhsm/libsofthsm2.so",
)
MODULE = next(
    (Path(place) for place in (os.environ.get("SOFTHSM2_MODULE"), *PLACES) if place and Path(place).is_file()), None
)
if MODULE is None or shutil.which("softhsm2-util") is None:
    pytest.skip("SoftHSM (softhsm2) is not installed; SOFTHSM2_MODULE names its library", allow_module_level=True)

TOKEN, PIN = "pkm rig", "4711-secret"
KINDS = {
    "RSA, 2048 bit": lambda: rsa.generate_private_key(65537, 2048),
    "P-256": lambda: ec.generate_private_key(ec.SECP256R1()),
    "P-384": lambda: ec.generate_private_key(ec.SECP384R1()),
}


@pytest.fixture(scope="module")
def token(tmp_path_factory):
    """A token with a key of each kind, labelled by it; the folder with their certificates."""
    folder = tmp_path_factory.mktemp("token")
    (folder / "tokens").mkdir()
    (folder / "softhsm2.conf").write_text(f"directories.tokendir = {folder / 'tokens'}\nlog.level = ERROR\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOFTHSM2_CONF", str(folder / "softhsm2.conf"))
        made = ["softhsm2-util", "--init-token", "--free", "--label", TOKEN, "--pin", PIN, "--so-pin", "12345678"]
        subprocess.run(made, check=True, capture_output=True)
        library = pkcs11.lib(str(MODULE))
        library.reinitialize()  # where it was loaded before it knew of the token
        with library.get_token(token_label=TOKEN).open(user_pin=PIN, rw=True) as session:
            for label, make in KINDS.items():
                key, certificate = key_and_certificate(label, key=make())
                pem_files(folder, label, key, certificate)[0].unlink()  # the token alone has the key
                put_into(session, label, key)
        yield folder
        pkcs11.unload(str(MODULE))


def put_into(session, label, key):
    form = (serialization.Encoding.DER, serialization.PrivateFormat.TraditionalOpenSSL, serialization.NoEncryption())
    decode = decode_rsa_private_key if isinstance(key, rsa.RSAPrivateKey) else decode_ec_private_key
    session.create_object({
        **decode(key.private_bytes(*form)), pkcs11.Attribute.LABEL: label, pkcs11.Attribute.TOKEN: True,
        pkcs11.Attribute.SENSITIVE: True, pkcs11.Attribute.EXTRACTABLE: False,
    })  # fmt: skip


@pytest.mark.parametrize("label", KINDS)
def test_what_a_token_signs_is_intact_and_by_its_certificate(token, label):
    asked = []
    with token_key(MODULE, TOKEN, label, token / f"{label}.pem", lambda prompt: asked.append(prompt) or PIN) as key:
        signed = sign(unsigned(), key)
    assert asked == [f"PIN of token '{TOKEN}': "]
    assert check(signed, "c", signer=token / f"{label}.pem").trusted
    assert PIN.encode() not in signed
    spoilt = signed.replace(b">6.9<", b">1.9<")
    assert spoilt != signed
    with pytest.raises(NotIntact, match="changed after it was signed"):
        check(spoilt, "c", signer=token / f"{label}.pem")


@pytest.mark.parametrize(
    ("name", "label", "pin", "said"),
    [
        (TOKEN, "P-256", "0000", "the PIN is not right"),
        (TOKEN, "no such key", PIN, "no key 'no such key'"),
        ("no such token", "P-256", PIN, "no token 'no such token'"),
    ],
)
def test_what_is_not_right_is_said_in_a_line_without_the_pin(token, name, label, pin, said):
    with (
        pytest.raises(InputError, match=said) as refused,
        token_key(MODULE, name, label, token / "P-256.pem", lambda _: pin),
    ):
        pass
    assert pin not in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_certificate_of_another_key_is_refused_before_anything_is_written(token):
    with (
        pytest.raises(InputError, match="not the key of"),
        token_key(MODULE, TOKEN, "P-256", token / "P-384.pem", lambda _: PIN) as key,
    ):
        sign(unsigned(), key)
