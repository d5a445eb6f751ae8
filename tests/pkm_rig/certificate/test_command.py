"""`pkm-rig certificate` as it is typed: statuses, one line for what is wrong, secrets asked for and shown nowhere."""

from __future__ import annotations

import getpass
import json

import pytest

pytest.importorskip("signxml")

from pkm_rig.certificate.keys import load_key
from pkm_rig.certificate.signature import sign
from tests.pkm_rig.certificate.certificates import key_and_certificate, pem_files, unsigned


@pytest.fixture
def signed(tmp_path):
    """A signed certificate, and the signer's."""
    paths = pem_files(tmp_path, "signer", *key_and_certificate())
    (tmp_path / "c.xml").write_bytes(sign(unsigned(), load_key(*paths, lambda _: "")))
    return tmp_path / "c.xml", paths[1]


def test_a_certificate_is_checked_against_its_signer(run, signed):
    file, signer = signed
    ended = run("certificate", "--check", file, "--signer", signer)
    said, *shown = ended.stdout.splitlines()
    assert (ended.returncode, said) == (0, "PKM-rig-1-1: intact, signed by CN=Signer")
    assert "RMS position error of the tool point, after 6.9 1.7 2 µm" in [" ".join(line.split()) for line in shown]
    found = json.loads(run("certificate", "--check", file, "--signer", signer, "--json").stdout)
    assert found["intact"]
    assert found["signer_checked"]
    assert {"name", "value", "unit", "expanded", "k"} <= set(found["quantities"][0])


def test_without_a_signer_the_status_says_that_it_was_not_checked(run, signed):
    ended = run("certificate", "--check", signed[0])
    assert ended.returncode == 1
    assert "intact, signer not checked" in ended.stdout
    assert len(ended.stderr.splitlines()) == 1


@pytest.mark.parametrize(("old", "new"), [(b">6.9<", b">1.9<"), (b">31.0<", b">3.10<")])
def test_a_changed_one_is_not_accepted(run, signed, old, new):
    file, signer = signed
    data = file.read_bytes()
    assert old in data
    file.write_bytes(data.replace(old, new, 1))
    ended = run("certificate", "--check", file, "--signer", signer)
    assert (ended.returncode, ended.stdout) == (1, "")
    assert "changed after it was signed" in ended.stderr


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ((), "of which campaign"),
        (("a", "--dcc", "2.0"), "--dcc 2.0: not written"),
        (("a", "--key", "k.pem"), "to sign give --signer"),
        (("a", "--signer", "c.pem"), "--signer goes with"),
        (("a", "--pkcs11", "lib.so", "--signer", "c.pem"), "needs --token and --key-label"),
        (("a", "--amends", "N"), "--why"),
        (("a", "--why", "x"), "--why goes with"),
        (("a", "--amends", "N", "--substitutes", "M", "--why", "x"), "give --amends or --substitutes"),
        (("a", "--check", "c.xml"), "--check takes a file"),
        (("--check", "missing.xml"), "No such file"),
        (("--check", "c.xml", "--signer", "a", "--ca", "b"), "not both"),
        (("a",), "there is no store"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_status_2(run, tmp_path, monkeypatch, arguments, complaint):
    monkeypatch.chdir(tmp_path)
    ended = run("certificate", *arguments)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert complaint in ended.stderr
    assert len(ended.stderr.splitlines()) == 1


def test_a_token_that_is_not_there_is_one_line_and_the_pin_is_not_in_it(run, tmp_path, monkeypatch):
    pytest.importorskip("pkcs11")
    from pkm_rig.certificate.keys import token_key  # noqa: PLC0415  # the extra may lack it

    signer = pem_files(tmp_path, "signer", *key_and_certificate())[1]
    monkeypatch.setattr(getpass, "getpass", lambda _: "1234-secret")
    with (
        pytest.raises(Exception, match="check module, token, label and PIN") as refused,
        token_key(tmp_path / "no-such-library.so", "t", "k", signer, getpass.getpass),
    ):
        pass
    assert "1234-secret" not in str(refused.value)
