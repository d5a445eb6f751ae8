"""Shuts a process in where it can open Python, a wheel and one recording, and nothing else; Linux only.

    python -I -S jail.py CONFIG

CONFIG is JSON: `way` (namespaces, landlock or none), `show` (paths outside, each with its path inside), `folder` (where
recordings come), `root` (an empty folder, for namespaces), `program` (a command), `environment`. The program is started
in place of this one. Standard library only; also imported by what is shut in, for `receive`.
"""

from __future__ import annotations

import ctypes
import json
import os
import struct
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

NAMESPACES, LANDLOCK, UNSEALED = "namespaces", "landlock", "none"

_NEW_MOUNTS, _NEW_USER, _NEW_IPC, _NEW_NET = 0x00020000, 0x10000000, 0x08000000, 0x40000000
_READ_ONLY, _REMOUNT, _BIND, _RECURSIVE, _PRIVATE = 1, 32, 4096, 16384, 1 << 18
_NO_SUID, _NO_DEV = 2, 4
# Of statvfs, with the same meaning for mount: flags that a bind in a user namespace must not drop.
_LOCKED = 2 | 4 | 8 | 1024 | 2048
_RELATIVE_TIME = (4096, 1 << 21)  # of statvfs, of mount
_DETACH = 2
_PIVOT_ROOT = {"x86_64": 155, "aarch64": 41}
_CAPSET = {"x86_64": 126, "aarch64": 91}
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446  # on every architecture
_NO_NEW_PRIVILEGES = 38
_CAPABILITIES_V3 = 0x20080522
_EXECUTE, _WRITE, _READ_FILE, _READ_FOLDER, _ALL = 1, 2, 4, 8, (1 << 13) - 1
_ON_FILES = _EXECUTE | _WRITE | _READ_FILE

_libc = ctypes.CDLL(None, use_errno=True)


class NoJail(RuntimeError):
    """The system does not let a process be shut in this way; one line."""


def main() -> None:
    """Shut this process in, then become the program."""
    config = json.loads(sys.argv[1])
    if config["way"] == NAMESPACES:
        enter_namespaces(config["show"], config["folder"], Path(config["root"]))
    elif config["way"] == LANDLOCK:
        enter_landlock(config["show"], config["folder"])
    os.execve(config["program"][0], config["program"], config["environment"])


def enter_namespaces(show: Sequence[Sequence[str]], folder: str, root: Path) -> None:
    """A file system of its own, of some paths read-only and an empty folder; no network."""
    own = _NEW_MOUNTS | _NEW_IPC | _NEW_NET
    user, group = os.getuid(), os.getgid()
    if user != 0 or _libc.unshare(own) != 0:
        _check(_libc.unshare(own | _NEW_USER), "unshare")
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"0 {user} 1")
        Path("/proc/self/gid_map").write_text(f"0 {group} 1")
    _mount("none", "/", "", _RECURSIVE | _PRIVATE)
    _mount("tmpfs", str(root), "tmpfs", _NO_SUID | _NO_DEV)
    for source, target in show:
        _show(Path(source), root / target.lstrip("/"))
    (root / folder.lstrip("/")).mkdir(parents=True, exist_ok=True)
    old = root / "old"
    old.mkdir()
    os.chdir(root)
    _check(_libc.syscall(_number(_PIVOT_ROOT), str(root).encode(), str(old).encode()), "pivot_root")
    os.chdir("/")
    _check(_libc.umount2(b"/old", _DETACH), "umount")
    Path("/old").rmdir()
    _mount("none", "/", "", _REMOUNT | _BIND | _READ_ONLY | _NO_SUID | _NO_DEV)


def enter_landlock(show: Sequence[Sequence[str]], folder: str) -> None:
    """Rules by which this process and its children may read some paths, read and write a folder, and nothing else."""
    rules = [(Path(source), _EXECUTE | _READ_FILE | _READ_FOLDER) for source, _ in show]
    _restrict(_ALL, [*rules, (Path(folder), _ALL)])


@contextmanager
def receive(way: str, folder: str, name: str, files: dict[str, str]) -> Iterator[Path]:
    """The files of a recording, in a folder of their own that cannot be written to: for a process that then ends.

    Where paths are real (landlock) the files go when the context does; a child must not outlive it.
    """
    if way == NAMESPACES:
        _check(_libc.unshare(_NEW_MOUNTS), "unshare")
        _mount("tmpfs", folder, "tmpfs", _NO_SUID | _NO_DEV)
    home = Path(folder) / name
    home.mkdir()
    for file, text in files.items():
        (home / file).write_text(text, encoding="utf-8")
    if way == NAMESPACES:
        _mount("none", folder, "", _REMOUNT | _BIND | _READ_ONLY | _NO_SUID | _NO_DEV)
        _drop_capabilities()
    elif way == LANDLOCK:
        _restrict(_ALL & ~(_EXECUTE | _READ_FILE | _READ_FOLDER), [])
    yield home


def _drop_capabilities() -> None:
    """What was mounted stays mounted."""
    _check(_libc.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0), "prctl")
    header = struct.pack("Ii", _CAPABILITIES_V3, 0)
    _check(_libc.syscall(_number(_CAPSET), header, bytes(24)), "capset")


def _show(source: Path, target: Path) -> None:
    """A path at its place in the new root, read-only; a link stays one."""
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.is_symlink():
        target.symlink_to(os.readlink(source))
        return
    if source.is_dir():
        target.mkdir(exist_ok=True)
    else:
        target.touch()
    _mount(str(source), str(target), "", _BIND | _RECURSIVE)
    has = os.statvfs(target).f_flag
    flags = (has & _LOCKED) | (_RELATIVE_TIME[1] if has & _RELATIVE_TIME[0] else 0)
    _mount("none", str(target), "", _REMOUNT | _BIND | _READ_ONLY | flags)


def _mount(source: str, target: str, kind: str, flags: int) -> None:
    done = _libc.mount(source.encode(), target.encode(), kind.encode(), ctypes.c_ulong(flags), None)
    _check(done, f"mount {target}")


def _restrict(handled: int, rules: Sequence[tuple[Path, int]]) -> None:
    """No right of `handled` any more but those of the rules."""
    attributes = struct.pack("Q", handled)
    ruleset = _check(_libc.syscall(_CREATE_RULESET, attributes, ctypes.c_size_t(8), 0), "landlock")
    for path, allowed in rules:
        opened = os.open(path, os.O_PATH | os.O_CLOEXEC)
        rights = allowed & handled if path.is_dir() else allowed & handled & _ON_FILES
        rule = struct.pack("=Qi", rights, opened)
        _check(_libc.syscall(_ADD_RULE, ruleset, 1, rule, 0), f"landlock {path}")
        os.close(opened)
    _check(_libc.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0), "prctl")
    _check(_libc.syscall(_RESTRICT_SELF, ruleset, 0), "landlock")
    os.close(ruleset)


def _number(by_machine: dict[str, int]) -> int:
    machine = os.uname().machine
    if machine not in by_machine:
        raise NoJail(f"no number of a system call is known for {machine}")
    return by_machine[machine]


def _check(result: Any, what: str) -> int:
    if result < 0:
        raise NoJail(f"{what}: {os.strerror(ctypes.get_errno())}")
    return int(result)


if __name__ == "__main__":
    try:
        main()
    except (NoJail, OSError) as error:
        print(f"jail: {error}", file=sys.stderr)
        sys.exit(3)
