"""A development set of withheld cases: what is refused."""

from __future__ import annotations

import sys

import pytest

from benchmarks.withheld import make_set


def test_an_unknown_kind_is_refused_before_anything_is_made(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["make_set", "--kinds", "null,nothing", "--out", str(tmp_path / "set")])
    with pytest.raises(SystemExit) as ended:
        make_set.main()
    assert ended.value.code == 2
    assert "no kind of case is called nothing" in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "set").exists()
