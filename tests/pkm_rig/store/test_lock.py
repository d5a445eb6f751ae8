from __future__ import annotations

import fcntl
import os
import pwd
import signal
import subprocess
import sys
from contextlib import closing, contextmanager

import pytest

from pkm_rig.errors import StoreError
from pkm_rig.jobs import session
from pkm_rig.store import lock
from pkm_rig.store.lock import Lock, user_name
from pkm_rig.store.store import Store, open_existing_store, open_store
from tests.pkm_rig.store.stores import small_store

HOLDS = """
import sys
from pathlib import Path
from pkm_rig.store.store import open_store
with open_store(Path(sys.argv[1]), hold=True):
    print("held", flush=True)
    sys.stdin.read()
"""


@contextmanager
def another_process(out):
    """A process that holds the store in a folder, killed in the end."""
    arguments = [sys.executable, "-c", HOLDS, str(out)]
    with subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "held\n"
            yield process
        finally:
            process.kill()


def test_a_store_that_is_held_names_its_owner_and_can_be_read(tmp_path):
    small_store(tmp_path / "pkm-rig.sqlite", "first")
    with another_process(tmp_path) as process:
        with pytest.raises(StoreError, match=rf"in use by '-c {tmp_path}', process {process.pid} of .* since 20.* UTC"):
            open_store(tmp_path, hold=True).__enter__()
        with open_existing_store(tmp_path) as store:
            assert len(store.recording("first")) == 7
        with open_store(tmp_path) as store:  # what is short, such as an import, waits for its turn
            store.add_event("first", "noted", {})


def test_a_killed_owner_frees_the_store_and_is_not_named(tmp_path):
    with another_process(tmp_path) as process:
        os.kill(process.pid, signal.SIGKILL)
        process.wait(timeout=10)
        with open_store(tmp_path, hold=True) as store:
            store.hold()  # again does nothing
            with pytest.raises(StoreError, match=f"process {os.getpid()} of"):
                open_store(tmp_path, hold=True).__enter__()
    assert (tmp_path / "pkm-rig.sqlite.lock").is_file()  # whoever deletes it would let two hold it


def test_closing_a_store_frees_it(tmp_path):
    for _ in range(2):
        with closing(Store(tmp_path / "store.sqlite")) as store:
            store.hold()


@pytest.mark.parametrize(
    "words",
    [("demo",), ("calibrate", "--rig", "embedded"), ("measure", "--rig", "embedded"),
     ("verify", "first", "--rig", "embedded")],
    ids=lambda words: words[0],
)  # fmt: skip
def test_a_store_that_is_held_keeps_out_a_campaign_before_any_device_is_touched(run, words, tmp_path, monkeypatch):
    def touch(*_, **__):
        raise AssertionError("a rig was connected")

    monkeypatch.setattr(session, "open_rig", touch)
    with closing(Store(small_store(tmp_path / "pkm-rig.sqlite", "first"))) as store:
        store.hold()
        done = run(*words, "--out", tmp_path)
    assert done.returncode == 3
    assert f"process {os.getpid()} of" in done.stderr


def test_who_runs_a_process_is_what_the_system_says_not_the_environment(monkeypatch):
    for name in ("LOGNAME", "USER", "LNAME", "USERNAME"):
        monkeypatch.setenv(name, "somebody else")
    assert user_name() == pwd.getpwuid(os.getuid()).pw_name
    monkeypatch.setattr(os, "getuid", lambda: 4_000_000_123)
    assert user_name() == "user 4000000123"


def test_who_only_looks_keeps_nobody_out(tmp_path, monkeypatch):
    """As `list` does, which asks for a shared lock to see whether there is an owner."""
    path = tmp_path / "lock"
    path.touch()
    looking = os.open(path, os.O_RDONLY)
    fcntl.flock(looking, fcntl.LOCK_SH)
    monkeypatch.setattr(lock.time, "sleep", lambda _: os.close(looking))
    Lock(path, "the rig").release()
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.close(looking)


@pytest.mark.parametrize("text", [b"", b"{", b"[1]", b'{"command": "x"}', b"\xff"])
def test_an_owner_who_did_not_say_who_he_is_is_another_process(tmp_path, text):
    path = tmp_path / "lock"
    first = Lock(path, "the rig")
    path.write_bytes(text)
    with pytest.raises(StoreError, match="the rig is in use by another process; wait"):
        Lock(path, "the rig")
    first.release()
    first.release()
    Lock(path, "the rig").release()


def test_a_place_where_no_lock_can_be_made_is_named(tmp_path):
    with pytest.raises(StoreError, match="cannot be opened: No such file or directory; choose another place"):
        Lock(tmp_path / "nowhere" / "lock", "the rig")
    (tmp_path / "target").write_text("precious")
    (tmp_path / "lock").symlink_to(tmp_path / "target")
    with pytest.raises(StoreError, match="cannot be opened"):
        Lock(tmp_path / "lock", "the rig")
    assert (tmp_path / "target").read_text() == "precious"
