"""Certificates for tests, from data written by hand, and keys with certificates of their own."""

from __future__ import annotations

import copy
from datetime import UTC, date, datetime, timedelta

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from pkm_rig.certificate.content import make_content
from pkm_rig.certificate.dcc import certificate_xml

FIGURES = {
    "position_rms_m": 31.0049e-6, "position_max_m": 57.513e-6, "orientation_rms_rad": 34.6e-6,
    "u_position_rms_m": 2.2e-6, "u_orientation_rms_rad": 3.0283e-6, "n": 40,
}  # fmt: skip
PARTY = {
    "name": "Metrology Ltd & <Co>",
    "email": "lab@example.org",
    "street": None,
    "postcode": "1",
    "city": "Ulm",
    "country": "DE",
}
DATA = {
    "campaign": "rig-1",
    "simulated": False,
    "software": "pkm-rig 0.1.0",
    "coverage_factor": 2.0,
    "state": "accepted",
    "decision": "accepted",
    "tables_as_found": "no table in use on any drive",
    "tables_as_left": "generation 3",
    "identity": {
        "machine": {"name": "planar4", "manufacturer": "Example AG", "model": "P4", "serial": "0042",
            "place": "hall 3"},
        "rig": "rig", "drives": [{"name": "left", "serial": 17}], "laboratory": PARTY, "customer": PARTY,
        "operator": "A. Example", "procedure": "QM 17-4", "location": "customer", "accreditation": None,
        "instruments": [{
            "instrument": "station", "model": "tracker", "serial": "990001", "number": "K-1", "laboratory": "Lab",
            "calibrated": None, "due": "2027-01-01", "state": "valid", "why": "",
        }],
        "measured": ["2026-11-22", "2026-11-23"], "traceable": True, "not_traceable": [],
    },
    "conditions": {
        "temperatures": [{"name": "air", "low_c": 20.914, "high_c": 21.0}], "pressure_hpa": 1008.46,
        "humidity_percent": 41.6,
    },
    "record": {"hashes": [{"of": "machine file", "sha256": "ab" * 32}]},
    "noise_floor_of_visits": FIGURES,
    "payloads": [{
        "name": "none", "payload_kg": 0.0, "limit_m": 10e-6, "guard_band_m": 1.66e-6,
        "before": FIGURES, "after": FIGURES | {"position_rms_m": 6.9e-6, "u_position_rms_m": 0.83e-6},
    }],
}  # fmt: skip


def data(**identity):
    """The data of a report; changes of its identity by their path, as in machine__serial."""
    out = copy.deepcopy(DATA)
    for path, value in identity.items():
        *parts, last = path.split("__")
        entry = out["identity"]
        for part in parts:
            entry = entry[part]
        entry[last] = value
    return out


def content(found=None, version="3.3.0", language="en", replaces=None):
    return make_content(found or data(), "PKM-rig-1-1", version, language, replaces, date(2026, 11, 23))


def unsigned():
    return certificate_xml(content())


def key_and_certificate(name="Signer", days=(-1, 1), issuer=None, ca=False, key=None):
    """A key, of P-256 if none is given, and its certificate, valid from and until so many days from now; self-signed,
    or issued.
    """
    key = key or ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    now = datetime.now(UTC)
    issuer_key, issuer_name = (key, subject) if issuer is None else (issuer[0], issuer[1].subject)
    certificate = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer_name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now + timedelta(days=days[0]))
        .not_valid_after(now + timedelta(days=days[1]))
        .add_extension(x509.BasicConstraints(ca=ca, path_length=None), critical=True)
        .sign(issuer_key, hashes.SHA256())
    )
    return key, certificate


def pem_files(folder, name, key, certificate, passphrase=None):
    """Paths of a key and of its certificate in PEM."""
    hidden = serialization.NoEncryption() if passphrase is None else serialization.BestAvailableEncryption(passphrase)
    key_path, certificate_path = folder / f"{name}.key.pem", folder / f"{name}.pem"
    key_path.write_bytes(key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, hidden))
    certificate_path.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
    return key_path, certificate_path
