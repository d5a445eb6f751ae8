"""What a signature covers, and that whatever else stands in a file is not believed."""

from __future__ import annotations

import random

import pytest

pytest.importorskip("signxml")

from signxml.algorithms import SignatureConstructionMethod
from signxml.signer import XMLSigner

from calibration.base.errors import InputError
from pkm_rig.certificate.keys import load_key
from pkm_rig.certificate.signature import in_one_form, sign
from pkm_rig.certificate.verification import NotIntact, check
from pkm_rig.certificate.xml_form import MOST_BYTES, SIGNATURE, canonical, etree, parse, read_bytes
from tests.pkm_rig.certificate.certificates import key_and_certificate, pem_files, unsigned


def no_question(prompt):
    raise AssertionError(prompt)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("keys")


@pytest.fixture(scope="module")
def signer(folder):
    return pem_files(folder, "signer", *key_and_certificate())


@pytest.fixture(scope="module")
def signed(signer):
    return sign(unsigned(), load_key(*signer, no_question))


def tree(data):
    return etree().fromstring(data)


def test_what_was_signed_is_intact_and_the_signer_the_one_named(signed, signer):
    found = check(signed, "c", signer=signer[1])
    assert found.trusted
    assert found.signer == "CN=Signer"
    assert canonical(found.root) == unsigned()


def test_without_a_signer_it_is_intact_but_the_signer_not_checked(signed):
    assert not check(signed, "c").trusted


def test_one_altered_byte_is_noticed_every_time(signed, signer):
    drawn = random.Random(1000)
    unnoticed = []
    for _ in range(1000):
        place, other = drawn.randrange(len(signed)), drawn.randrange(1, 256)
        spoilt = signed[:place] + bytes([signed[place] ^ other]) + signed[place + 1 :]
        try:
            check(spoilt, "c", signer=signer[1])
        except InputError:
            continue
        unnoticed.append((place, other))
    assert not unnoticed


def test_one_byte_more_or_less_is_noticed(signed, signer):
    for spoilt in (signed + b"\n", b" " + signed, signed[:-1], signed.replace(b"><", b">\n<", 1)):
        with pytest.raises(InputError):
            check(spoilt, "c", signer=signer[1])


def test_a_second_signature_is_refused(signed, signer, folder):
    other = load_key(*pem_files(folder, "other", *key_and_certificate("Other")), no_question)
    with pytest.raises(InputError, match="signed already"):
        sign(signed, other)
    root = tree(signed)
    root.append(tree(signed)[-1])
    with pytest.raises(NotIntact, match="not the only one"):
        check(canonical(root), "c", signer=signer[1])


def test_a_signed_part_that_is_wrapped_in_another_document_is_refused(signed, signer):
    forged = tree(unsigned().replace(b">0042<", b">9999<"))
    wrapped = tree(signed)
    signature = wrapped[-1]
    comment = etree().SubElement(forged, "{https://ptb.de/dcc}comment")
    comment.append(wrapped)
    with pytest.raises(NotIntact):
        check(canonical(forged), "c", signer=signer[1])
    forged.append(signature)
    with pytest.raises(NotIntact):
        check(canonical(forged), "c", signer=signer[1])


def test_a_signature_of_a_part_only_is_refused(signed, signer, folder):
    """The signature itself is good: it refers to a part by its id."""
    key = load_key(*signer, no_question)
    root = tree(unsigned())
    root[1].set("Id", "part")
    maker = XMLSigner(
        method=SignatureConstructionMethod.enveloped, signature_algorithm="ecdsa-sha256", digest_algorithm="sha256",
        c14n_algorithm="http://www.w3.org/TR/2001/REC-xml-c14n-20010315",
    )  # fmt: skip
    partly = canonical(
        in_one_form(
            maker.sign(root, key=key.private, cert=[key.certificate], reference_uri="#part"), key.certificate_der
        )
    )
    with pytest.raises(NotIntact, match=r"does not cover|changed after"):
        check(partly, "c", signer=signer[1])


def test_a_forgery_signed_anew_is_refused_by_signer_and_by_issuer(folder, signer):
    forged = unsigned().replace(b">6.9<", b">1.9<")
    assert forged != unsigned()
    other = pem_files(folder, "forger", *key_and_certificate("Signer"))
    spoilt = sign(forged, load_key(*other, no_question))
    assert check(spoilt, "c").signer == "CN=Signer"
    with pytest.raises(NotIntact, match="which is not"):
        check(spoilt, "c", signer=signer[1])
    authority = pem_files(folder, "authority", *key_and_certificate("Authority", ca=True))
    with pytest.raises(NotIntact, match="did not issue"):
        check(spoilt, "c", ca=authority[1])


@pytest.mark.parametrize(("is_authority", "complaint"), [(True, None), (False, "did not issue")])
def test_an_issuer_must_be_one(folder, is_authority, complaint):
    issuer = key_and_certificate("Authority", ca=is_authority)
    path = pem_files(folder, f"issuer-{is_authority}", *issuer)[1]
    one = pem_files(folder, f"issued-{is_authority}", *key_and_certificate("Issued", issuer=issuer))
    data = sign(unsigned(), load_key(*one, no_question))
    if complaint is None:
        assert check(data, "c", ca=path).trusted
    else:
        with pytest.raises(NotIntact, match=complaint):
            check(data, "c", ca=path)


def test_an_expired_certificate_neither_signs_nor_is_believed(folder, monkeypatch):
    old = pem_files(folder, "old", *key_and_certificate(days=(-9, -2)))
    with pytest.raises(InputError, match="expired on"):
        load_key(*old, no_question)
    with monkeypatch.context() as patch:
        patch.setattr("pkm_rig.certificate.keys.require_valid_now", lambda *_: None)
        data = sign(unsigned(), load_key(*old, no_question))
    with pytest.raises(InputError, match="expired on"):
        check(data, "c", signer=old[1])
    not_yet = pem_files(folder, "not-yet", *key_and_certificate(days=(2, 9)))
    with pytest.raises(InputError, match="valid from"):
        load_key(*not_yet, no_question)


def test_a_passphrase_is_asked_for_and_a_wrong_one_or_a_key_of_another_refused(folder, signer):
    locked = pem_files(folder, "locked", *key_and_certificate(), passphrase=b"correct horse")
    asked = []
    key = load_key(*locked, lambda prompt: asked.append(prompt) or "correct horse")
    assert len(asked) == 1
    assert check(sign(unsigned(), key), "c", signer=locked[1]).trusted
    with pytest.raises(InputError, match="does not open it"):
        load_key(*locked, lambda _: "wrong")
    with pytest.raises(InputError, match="not the key of"):
        load_key(locked[0], signer[1], lambda _: "correct horse")
    with pytest.raises(InputError, match="no private key"):
        load_key(signer[1], signer[1], no_question)
    with pytest.raises(InputError, match="no certificate"):
        load_key(signer[0], signer[0], no_question)


@pytest.mark.parametrize(
    "head",
    [b'<?xml version="1.0"?>', b"<!DOCTYPE a>", b'<!DOCTYPE a [<!ENTITY e "x">]>', b"<!-- -->", b"<?stylesheet x?>"],
)
def test_declarations_entities_and_comments_are_refused_before_they_are_read(signed, head):
    with pytest.raises(InputError, match="not in the form"):
        parse(head + signed, "c")


def test_other_xml_large_files_and_what_is_not_signed_are_refused(tmp_path):
    with pytest.raises(InputError, match="not a Digital"):
        parse(b"<a></a>", "c")
    with pytest.raises(InputError, match="larger than"):
        parse(b"<a>" + b"x" * MOST_BYTES + b"</a>", "c")
    (tmp_path / "big.xml").write_bytes(b"x" * (MOST_BYTES + 1))
    with pytest.raises(InputError, match="larger than"):
        read_bytes(tmp_path / "big.xml")
    with pytest.raises(NotIntact, match="not signed"):
        check(unsigned(), "c")


def test_nothing_may_hide_in_the_signature(signed, signer):
    for name in ("KeyInfo", "SignatureValue", "X509Certificate"):
        root = tree(signed)
        element = next(root.iter(f"{{{SIGNATURE}}}{name}"))
        element.set("note", "hidden")
        with pytest.raises(NotIntact):
            check(canonical(root), "c", signer=signer[1])
