"""A development set of withheld cases: what is refused."""

from __future__ import annotations

import sys

import pytest

from benchmarks.withheld import make_set


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        (("--kinds", "null,nothing"), "no kind of case is called nothing"),
        (("--n", "0"), "--n must be positive"),
        (("--seed", "-1"), "--seed not negative"),
        (("--effects", "nothing"), "no case of nothing among 200"),
    ],
)
def test_what_cannot_be_made_is_refused_before_anything_is(tmp_path, monkeypatch, capsys, bad, said):
    monkeypatch.setattr(sys, "argv", ["make_set", *bad, "--out", str(tmp_path / "set")])
    with pytest.raises(SystemExit) as ended:
        make_set.main()
    assert ended.value.code == 2
    assert said in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "set").exists()
