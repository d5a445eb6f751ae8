"""Keys that sign: a file in PEM, or a token by PKCS#11. Passphrases and PINs are asked for and kept nowhere."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from calibration.base.errors import InputError
from calibration.base.plain_file import read_text
from pkm_rig.certificate.xml_form import MISSING

Ask = Callable[[str], str]  # asks for a secret without showing it


@dataclass(frozen=True)
class SigningKey:
    """A private key (anything with the `sign` of `cryptography`), its certificate, and XML Signature's algorithm."""

    private: Any
    certificate: str
    certificate_der: bytes
    algorithm: str


def load_certificate(path: Path) -> Any:
    """An X.509 certificate in PEM; InputError if it is none."""
    _require_cryptography()
    from cryptography import x509  # noqa: PLC0415  # of an extra

    try:
        return x509.load_pem_x509_certificate(read_text(path).encode())
    except ValueError as error:
        raise InputError(f"{path}: no certificate in PEM; convert it with `openssl x509 -outform PEM`") from error


def load_key(key_path: Path, certificate_path: Path, ask: Ask) -> SigningKey:
    """The key in a PEM file; its passphrase is asked for if it is encrypted. InputError if it does not fit."""
    _require_cryptography()
    from cryptography.hazmat.primitives import serialization  # noqa: PLC0415

    certificate = load_certificate(certificate_path)
    text = read_text(key_path).encode()
    try:
        private = serialization.load_pem_private_key(text, None)
    except TypeError:  # it is encrypted
        secret = ask(f"passphrase of {key_path}: ").encode()
        try:
            private = serialization.load_pem_private_key(text, secret)
        except ValueError as error:
            raise InputError(f"{key_path}: the passphrase does not open it; nothing was written") from error
    except ValueError as error:
        raise InputError(f"{key_path}: no private key in PEM") from error
    if _public_bytes(private.public_key()) != _public_bytes(certificate.public_key()):
        raise InputError(f"{key_path}: not the key of {certificate_path}; name the certificate that belongs to it")
    return _signing_key(private, certificate, certificate_path)


@contextmanager
def token_key(module: Path, token: str, label: str, certificate_path: Path, ask: Ask) -> Iterator[SigningKey]:
    """The key of a token by PKCS#11, open meanwhile; its PIN is asked for. InputError where it is not there."""
    _require_cryptography()
    if importlib.util.find_spec("pkcs11") is None:
        raise InputError(MISSING)
    import pkcs11  # noqa: PLC0415  # of an extra

    certificate = load_certificate(certificate_path)
    try:
        slot = pkcs11.lib(str(module)).get_token(token_label=token)
        with slot.open(user_pin=ask(f"PIN of token '{token}': ")) as session:
            private = session.get_key(object_class=pkcs11.ObjectClass.PRIVATE_KEY, label=label)
            yield _signing_key(_TokenKey(private, certificate, certificate_path), certificate, certificate_path)
    except pkcs11.NoSuchToken as error:
        raise InputError(f"--pkcs11 {module}: there is no token '{token}' in it; name it with --token") from error
    except (pkcs11.NoSuchKey, pkcs11.MultipleObjectsReturned) as error:
        many = "no" if isinstance(error, pkcs11.NoSuchKey) else "more than one"
        raise InputError(
            f"--pkcs11 {module}: token '{token}' has {many} key '{label}'; name it with --key-label"
        ) from error
    except (pkcs11.PinIncorrect, pkcs11.PinInvalid, pkcs11.PinLenRange, pkcs11.PinLocked) as error:
        wrong = "is locked" if isinstance(error, pkcs11.PinLocked) else "is not right"
        raise InputError(f"--pkcs11 {module}: the PIN {wrong}; nothing was written") from error
    except (pkcs11.PKCS11Error, RuntimeError, OSError) as error:
        said = str(error) or type(error).__name__
        raise InputError(f"--pkcs11 {module}: {said}; check module, token, label and PIN") from error


class _TokenKey:
    """A key of a token with the `sign` of `cryptography`."""

    def __init__(self, private: Any, certificate: Any, certificate_path: Path) -> None:
        self._private, self._certificate, self._path = private, certificate, certificate_path
        self.key_size = certificate.public_key().key_size  # bits; XML Signature pads both numbers of ECDSA to it

    def sign(self, data: bytes, *arguments: Any, **options: Any) -> bytes:
        """Sign with SHA-256, by RSA (PKCS #1 v1.5) or ECDSA, which cryptography writes in DER.

        InputError where the certificate's key does not verify it: a token cannot be asked whose key it has.
        """
        import pkcs11  # noqa: PLC0415
        from cryptography.exceptions import InvalidSignature  # noqa: PLC0415
        from cryptography.hazmat.primitives import hashes  # noqa: PLC0415
        from cryptography.hazmat.primitives.asymmetric import ec, padding, rsa, utils  # noqa: PLC0415

        public = self._certificate.public_key()
        try:
            if isinstance(public, rsa.RSAPublicKey):
                signature = bytes(self._private.sign(data, mechanism=pkcs11.Mechanism.SHA256_RSA_PKCS))
                public.verify(signature, data, padding.PKCS1v15(), hashes.SHA256())
                return signature
            digest = hashes.Hash(hashes.SHA256())
            digest.update(data)
            raw = bytes(self._private.sign(digest.finalize(), mechanism=pkcs11.Mechanism.ECDSA))
            half = len(raw) // 2
            r, s = (int.from_bytes(part, "big") for part in (raw[:half], raw[half:]))
            signature = utils.encode_dss_signature(r, s)
            public.verify(signature, data, ec.ECDSA(hashes.SHA256()))
        except (InvalidSignature, pkcs11.KeyTypeInconsistent) as error:
            raise InputError(
                f"the token's key is not the key of {self._path}; name the certificate that belongs to it"
            ) from error
        return signature


def _signing_key(private: Any, certificate: Any, path: Path) -> SigningKey:
    from cryptography.hazmat.primitives import serialization  # noqa: PLC0415
    from cryptography.hazmat.primitives.asymmetric import ec, rsa  # noqa: PLC0415

    require_valid_now(certificate, str(path))
    public = certificate.public_key()
    if isinstance(public, rsa.RSAPublicKey):
        algorithm = "rsa-sha256"
    elif isinstance(public, ec.EllipticCurvePublicKey):
        algorithm = "ecdsa-sha256"
    else:
        raise InputError(f"{path}: its key is neither RSA nor of an elliptic curve; use one of these")
    encoding = serialization.Encoding
    return SigningKey(
        private,
        certificate.public_bytes(encoding.PEM).decode("ascii"),
        certificate.public_bytes(encoding.DER),
        algorithm,
    )


def require_valid_now(certificate: Any, name: str, now: datetime | None = None) -> None:
    """InputError for a certificate whose time is over or has not begun."""
    now = now or datetime.now(UTC)
    if now > certificate.not_valid_after_utc:
        raise InputError(f"{name}: the signer's certificate expired on {certificate.not_valid_after_utc:%Y-%m-%d}")
    if now < certificate.not_valid_before_utc:
        raise InputError(f"{name}: the signer's certificate is valid from {certificate.not_valid_before_utc:%Y-%m-%d}")


def _public_bytes(key: Any) -> bytes:
    from cryptography.hazmat.primitives import serialization  # noqa: PLC0415

    data: bytes = key.public_bytes(serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo)
    return data


def _require_cryptography() -> None:
    if importlib.util.find_spec("cryptography") is None:
        raise InputError(MISSING)
