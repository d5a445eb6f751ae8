"""Programs beside one another: what counts as an answer, how programs are run, what is counted."""

from __future__ import annotations

import json
import math
import pickle
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.gapbench import cases, entries, run, train
from benchmarks.gapbench.answer import NAMES, Answer, NotAnAnswer, read_answer
from benchmarks.gapbench.cases import BenchCase, CaseSet
from benchmarks.gapbench.features import features_of
from benchmarks.gapbench.program import PYTHON, Entry, Trial, Tried, entry_of
from benchmarks.gapbench.programs import classifier, greedy_bic, ours
from benchmarks.gapbench.score import log_score, printed, row_of, table
from benchmarks.results_file import ROOT
from benchmarks.withheld import stand_in
from benchmarks.withheld.jail import UNSEALED
from benchmarks.withheld.sealed_diagnoser import NotSealed
from calibration.recording.folder import read_folder
from mock_devices.effects import CATALOGUE
from tests.kept_results import until_stopped

RECORDING = ROOT / "tests" / "data" / "version_0_1" / "recording"
SURE_OF_NONE = '{"verdict": "none", "ranking": {"none": 1.0}}'
on_linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="namespaces and Landlock are Linux's")


# --- the answer


@st.composite
def answers(draw):
    """An answer in JSON, and what it says."""
    names = draw(st.lists(st.sampled_from(NAMES), min_size=1, max_size=6, unique=True))
    weights = [draw(st.integers(1, 1000)) for _ in names]
    ranking = {name: weight / sum(weights) for name, weight in zip(names, weights, strict=True)}
    shrink = draw(st.none() | st.floats(-10.0, 1.0))
    where = draw(st.sampled_from(["own", "gap"]))
    data = {"verdict": draw(st.sampled_from(names)), "ranking": ranking}
    data |= {"shrink": shrink} if where == "own" else {"gap": {"shrink": shrink, "before_m": 1e-5}}
    data |= draw(st.dictionaries(st.sampled_from(["remarks", "effects", "seconds"]), st.integers() | st.text()))
    return json.dumps(data), Answer(data["verdict"], ranking, shrink)


@settings(max_examples=40)
@given(answers())
def test_an_answer_is_read_as_it_was_written(written):
    text, answer = written
    assert read_answer(f"\n{text}\n") == answer


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.sampled_from(NAMES),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["verdict", "ranking", "shrink", "gap", *NAMES[:3]]), inner, max_size=4)
    ),
    max_leaves=12,
)


CUT_OFF = answers().flatmap(lambda pair: st.integers(0, len(pair[0])).map(lambda k: pair[0][:k]))


@settings(max_examples=80)
@given(st.text() | JSON.map(json.dumps) | CUT_OFF)
def test_whatever_is_printed_is_an_answer_or_said_in_a_line_not_to_be_one(text):
    try:
        answer = read_answer(text)
    except NotAnAnswer as error:
        (line,) = str(error).splitlines()
        assert ";" in line  # what is wrong; what to do
        assert len(line) < 300
    else:
        assert answer.verdict in answer.ranking.keys() & set(NAMES)
        assert abs(sum(answer.ranking.values()) - 1.0) < 1e-3
        assert answer.shrink is None or answer.shrink <= 1.0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "nothing was printed; print one JSON object"),
        ("reading ...\n", "line 1, column 1: no JSON (expecting value) in 'reading ...\\n'"),
        (SURE_OF_NONE + "\ndone", "line 2: something follows the JSON object"),
        (SURE_OF_NONE + SURE_OF_NONE, "line 1: something follows the JSON object"),
        (SURE_OF_NONE[:-1], "line 1, column 45: no JSON (expecting ',' delimiter)"),
        ("[" * 100_000, "no JSON that can be read in '[[["),
        ('{"verdict": ' + "9" * 5000 + "}", "no JSON that can be read in"),
        ('["none"]', "\"['none']\" is no JSON object"),
        ('{"verdict": "none", "verdict": "none", "ranking": {"none": 1}}', "the key 'verdict' is there more than once"),
        ('{"verdict": "none", "ranking": {"none": NaN}}', "NaN is no JSON number"),
        ('{"ranking": {"none": 1}}', "verdict: 'None' is no name of an effect"),
        ('{"verdict": "Backlash", "ranking": {"backlash": 1}}', "verdict: 'Backlash' is no name of an effect"),
        ('{"verdict": "none"}', "ranking: 'None' is no object"),
        ('{"verdict": "none", "ranking": {}}', "ranking: '{}' is no object"),
        ('{"verdict": "none", "ranking": {"play": 1}}', "ranking: 'play' is no name of an effect"),
        ('{"verdict": "none", "ranking": {"none": true}}', "ranking: the probability of 'none' is 'True'"),
        ('{"verdict": "none", "ranking": {"none": 1e999}}', "ranking: the probability of 'none' is 'inf'"),
        ('{"verdict": "none", "ranking": {"none": 1.01}}', "ranking: the probability of 'none' is '1.01'"),
        ('{"verdict": "none", "ranking": {"none": 0.5, "unknown": 0.4}}', "ranking: the probabilities add up to 0.9"),
        ('{"verdict": "none", "ranking": {"unknown": 1}}', "ranking: the verdict 'none' is not in it"),
        (SURE_OF_NONE[:-1] + ', "shrink": 1.1}', "shrink: '1.1'; give the share"),
        (SURE_OF_NONE[:-1] + ', "gap": {"shrink": "half"}}', "shrink: 'half'; give the share"),
    ],
)  # fmt: skip
def test_what_is_no_answer_is_named(text, said):
    with pytest.raises(NotAnAnswer) as raised:
        read_answer(text)
    assert str(raised.value).startswith(said)


def test_the_page_shows_an_answer_and_all_names():
    page = (ROOT / "docs" / "how-to" / "enter-gapbench.md").read_text(encoding="utf-8")
    (example,) = [part.partition("```")[0] for part in page.split("```json")[1:]]
    assert read_answer(example).verdict in CATALOGUE
    assert all(f"`{name}`" in page for name in NAMES)


# --- programs


def entry(code, name="tried"):
    return Entry(name, (PYTHON, "-I", "-S", "-c", code, "{folder}"))


def test_what_prints_rubbish_fails_or_hangs_has_answered_wrongly():
    trial = Trial(UNSEALED, limit_s=20.0)
    files = {"readings.csv": "uid\n"}
    good = trial.run(
        entry(f"import os, sys; assert os.listdir(sys.argv[1]) == ['readings.csv']; print('{SURE_OF_NONE}')"), files
    )
    assert (good.answer, good.failure) == (Answer("none", {"none": 1.0}, None), "")
    rubbish = trial.run(entry("print('well ...')"), files)
    assert rubbish.failure.startswith("line 1, column 1: no JSON (expecting value) in 'well ...")
    failed = trial.run(entry(f"print('{SURE_OF_NONE}'); raise RuntimeError('no such effect')"), files)
    assert failed.failure == "ended with status 1: RuntimeError: no such effect"
    silent = trial.run(entry("import sys; sys.stdin.read(); sys.exit(4)"), files)
    assert silent.failure == "ended with status 4: it said nothing on standard error"
    killed = trial.run(entry("import os, signal; os.kill(os.getpid(), signal.SIGKILL)"), files)
    assert killed.failure.startswith("was ended by SIGKILL")
    much = trial.run(entry("print('x' * 5_000_000)"), files)
    assert "File too large" in much.failure
    hanging = Trial(UNSEALED, limit_s=0.05).run(entry("import os; os.read(os.pipe()[0], 1)"), files)
    assert hanging.failure == "was not done after 0.25 s by the clock and was ended"
    assert {tried.answer for tried in (rubbish, failed, silent, killed, much, hanging)} == {None}


@on_linux
@pytest.mark.parametrize("way", ["namespaces", "landlock"])
def test_a_program_that_is_shut_in_sees_the_recording_and_itself(way, tmp_path):
    trial = Trial(way)
    (tmp_path / "program.py").write_text("import json, os, sys\nprint(json.dumps(os.listdir(sys.argv[1])))")
    shown = entry_of(f"shown={{python}} {tmp_path}/program.py {{folder}}", ())
    try:
        trial.prove(shown)
    except NotSealed as error:
        if "cannot be shut in by" in str(error):
            pytest.skip(f"no {way} here")
        raise
    assert trial.run(shown, {"machine.toml": "x"}).failure.startswith("\"['machine.toml']\" is no JSON object")
    with pytest.raises(NotSealed, match=r"shown could open .*; nothing is scored"):
        trial.prove(Entry("shown", shown.command, (ROOT,)))


def test_without_a_way_to_shut_programs_in_nothing_is_scored(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("benchmarks.gapbench.program.WAYS", ("none of them",))
    monkeypatch.setattr("benchmarks.gapbench.program.PYTHON", "/bin/false")
    assert run.main(["--out", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("gapbench: programs cannot be shut in here")
    assert "--unsealed" in line


@pytest.mark.parametrize(
    ("text", "show", "said"),
    [
        ("true {folder}", (), "give NAME=COMMAND"),
        ("a=true", (), "with {folder} where"),
        ("a=no-such-program {folder}", (), "there is no program 'no-such-program'"),
        (f"a=true {ROOT}/Makefile {{folder}}", (), "is part of the checkout"),
        ("a=true {folder}", (ROOT.parent,), "or holds it"),
        ("a=true {folder}", (ROOT / "nowhere",), "does not exist"),
    ],
)
def test_a_command_that_cannot_be_run_is_refused_in_a_line(text, show, said, capsys):
    with pytest.raises(ValueError, match=r".") as raised:
        entry_of(text, show)
    (line,) = str(raised.value).splitlines()
    assert said in line
    with pytest.raises(SystemExit):
        run.main(["--program", text, *(word for path in show for word in ("--show", str(path)))])
    assert said in capsys.readouterr().err


def test_names_are_those_of_the_shipped_programs_and_differ(capsys):
    for arguments, said in (
        (["--entries", "theirs"], "there is no 'theirs'"),
        (["--program", "ours=true {folder}"], "a name of its own"),
        (["--entries", ""], "at least one program"),
        (["--structures", "0", "--named", "0"], "not both zero"),
        (["--seed", "1000000"], "those of the training"),
        (["--limit-s", "0"], "--limit-s must be positive"),
    ):
        with pytest.raises(SystemExit):
            run.main(arguments)
        assert said in capsys.readouterr().err


def test_a_staged_program_holds_nothing_of_the_makers(tmp_path, monkeypatch):
    compiled = []
    monkeypatch.setattr(entries.compileall, "compile_dir", lambda folder, **_: compiled.append(folder))
    (tmp_path / "model").write_bytes(b"trees")
    home = entries.staged(tmp_path / "programs", {entries.MODEL: tmp_path / "model"})
    held = {str(file.relative_to(home)) for file in home.rglob("*") if file.is_file()}
    assert {entries.MODEL, "calibration/__init__.py", "calibration/machine/data/planar4.toml"} <= held
    assert {f"benchmarks/gapbench/programs/{name}.py" for name in entries.NAMES} <= held
    assert len(compiled) == 1
    others = [name for name in held if not name.startswith("calibration/") and name.endswith(".py")]
    assert not [
        name for name in others if any(word in name for word in ("structures", "making", "maker", "truth", "cases"))
    ]
    assert entries.staged(tmp_path / "programs", {entries.MODEL: tmp_path / "model"}) == home
    (tmp_path / "model").write_bytes(b"more trees")
    assert entries.staged(tmp_path / "programs", {entries.MODEL: tmp_path / "model"}) != home


# --- the shipped programs


def test_shipped_programs_print_answers(monkeypatch, capsys):
    monkeypatch.setattr(ours, "diagnose", stand_in.diagnose)
    assert ours.main(str(RECORDING)) == 0
    assert read_answer(capsys.readouterr().out).shrink == 0.5
    monkeypatch.setattr(greedy_bic, "simple_answers", lambda recording: {"greedy_bic": "latency"})
    assert greedy_bic.main(str(RECORDING)) == 0
    assert read_answer(capsys.readouterr().out) == Answer("latency", {"latency": 1.0}, None)


def test_the_classifier_prints_the_probabilities_of_its_trees(monkeypatch, capsys, tmp_path):
    pytest.importorskip("sklearn", reason="of the extra 'gapbench'")
    features = [[k, -k] for k in range(8)]
    fitted = train._fitted(np.array(features), ["none"] * 4 + ["backlash"] * 4, trees=9)
    (tmp_path / "model").write_bytes(pickle.dumps(fitted))
    monkeypatch.setattr(classifier, "features_of", lambda recording: np.array([7.0, -7.0]))
    assert classifier.main(str(tmp_path / "model"), str(RECORDING)) == 0
    answer = read_answer(capsys.readouterr().out)
    assert answer.verdict == "backlash"
    assert answer.ranking["backlash"] > 0.5


def test_a_classifier_is_trained_once_on_cases_of_other_seeds(monkeypatch, tmp_path, capsys):
    asked = []

    def generator(seed):
        truths = {
            k: {"kind": "known", "names": ["latency"]} if k % 2 else {"kind": "null", "names": []} for k in range(3)
        }
        return SimpleNamespace(case=lambda k: asked.append((seed, k)) or SimpleNamespace(truth=truths[k], recording=k))

    monkeypatch.setattr(train, "find_spec", lambda name: name)
    monkeypatch.setattr(train, "SAME_DESIGNS", 2)
    monkeypatch.setattr(train, "Generator", generator)
    monkeypatch.setattr(train, "as_read", lambda recording, machine: recording)
    monkeypatch.setattr(train, "features_of", lambda recording: np.array([recording, 1.0]))
    monkeypatch.setattr(train, "_fitted", lambda features, labels: (features.tolist(), labels))
    file = train.train(3, tmp_path, RECORDING)
    assert asked == [(train.OTHER_SEED, 0), (train.OTHER_SEED, 1), (train.OTHER_SEED + 1, 2)]
    assert pickle.loads(file.read_bytes()) == ([[0.0, 1.0], [1.0, 1.0], [2.0, 1.0]], ["none", "latency", "none"])
    assert train.train(3, tmp_path, RECORDING) == file
    assert train.train(2, tmp_path, RECORDING) != file
    assert len(asked) == 3
    monkeypatch.setattr(train, "find_spec", lambda name: None)
    assert run.main(["--unsealed", "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("gapbench: scikit-learn is not installed; pip install")


def test_features_are_finite_and_tell_an_error_from_none():
    recording = read_folder(RECORDING)
    plain = features_of(recording)
    assert np.all(np.isfinite(plain))
    side = recording.drives("direction")[:, 0]
    assert np.ptp(side) > 0.0
    off = recording.columns | {"y_m": recording["y_m"] + 2e-5 * side}
    changed = features_of(type(recording)(recording.file, recording.machine, off))
    assert changed.shape == plain.shape
    assert np.max(changed - plain) > 2.0


def test_classes_are_right_answers():
    assert train.label_of("known", ["latency", "backlash"]) == "latency"
    assert [train.label_of(kind, []) for kind in ("outside", "null")] == ["unknown", "none"]


# --- cases and scores


def test_named_cases_are_large_declared_right_and_drawn_again_until_seen(monkeypatch):
    asked = []

    def made(slot, rng, designs, final):
        asked.append(slot)
        assert final is False
        eligible = slot.kind == "null" or len(asked) % 2 == 0
        effects = [{"effect": name} for name in slot.effects]
        return SimpleNamespace(
            truth={"eligible": eligible, "effects": effects, "raw": 3.0, "profile": "small"}, recording=slot
        )

    monkeypatch.setattr(cases, "make_case", made)
    monkeypatch.setattr(cases, "texts_of", lambda slot: {"slot": slot.key})
    chosen = CaseSet(4, structures=2, named=8)
    of = [chosen.case(number).truth for number in range(2, 10)]
    assert (chosen.key(1), chosen.key(2)) == ("s4-1", "w4-0")
    assert [truth["kind"] for truth in of] == ["known", "outside", "known", "null"] * 2
    assert all(len(truth["names"]) == (truth["kind"] == "known") for truth in of)
    assert all(slot.declared == "right" and not slot.decoy for slot in asked)
    assert all(min(slot.raw) >= 3.0 for slot in asked if slot.raw)
    assert len({slot.key for slot in asked}) == len(asked) > 8
    monkeypatch.setattr(cases, "make_case", lambda *_, final: SimpleNamespace(truth={"eligible": False}))
    with pytest.raises(cases.NoCase, match="w4-0"):
        chosen.case(2)


def truth(key, kind, *names):
    return {"key": key, "kind": kind, "names": list(names)}


def tried(verdict, shrink=None, **ranking):
    return Tried(Answer(verdict, ranking, shrink), "", 2.0)


def test_the_table_is_counted_by_hand():
    failed = Tried(None, "nothing was printed; print", 1.0)
    two = ("backlash", "friction_windup")
    of = [truth("a", "known", *two), truth("b", "known", "latency"), truth("c", "outside"), truth("d", "null")]
    given = [
        tried("friction_windup", 0.5, friction_windup=0.995, backlash=0.005),
        tried("backlash", 0.3, backlash=0.6, unknown=0.2, latency=0.2),
        tried("unknown", None, unknown=0.995, none=0.005),
        tried("backlash", None, backlash=1.0),
    ]
    one = [row_of(*pair) for pair in zip(of, given, strict=True)]
    other = [row_of(each, failed) for each in of]
    cells = {name.strip(): row for name, row in table({"one": one, "other": other})}
    assert cells["known effect named right"] == ["50 % (9 to 91, n 2)", "0 % (0 to 66, n 2)"]
    assert cells["one right name among the first three"][0].startswith("100 %")
    assert cells["another effect named"][0].startswith("50 %")
    assert cells["outside called unknown"] == ["100 % (21 to 100, n 1)", "0 % (0 to 79, n 1)"]
    assert cells["null called an effect"] == ["100 % (21 to 100, n 1)", "0 % (0 to 79, n 1)"]
    assert cells["right when p > 0.99"] == ["67 % (21 to 94, n 3)", "-"]
    assert cells["all answers right"] == ["50 % (15 to 85, n 4)", "0 % (0 to 49, n 4)"]
    assert cells["no answer (counts as wrong)"] == ["0 % (0 to 49, n 4)", "100 % (51 to 100, n 4)"]
    assert cells["stated shrink, median (not scored)"] == ["0.4", "-"]
    assert cells["seconds a recording, median"] == ["2", "1"]
    logs = [log_score(row) for row in one]
    assert logs == pytest.approx([0.0, -math.log(0.2), -math.log(0.995), -math.log(1e-6)])
    text = printed({"one": one, "other": other})
    assert "other, c: nothing was printed; print" in text
    assert "one, " not in text


def test_programs_are_run_on_the_same_cases_and_go_on_when_stopped(tmp_path, monkeypatch, capsys):
    made, stop = [], [2]

    class Cases:
        count = 2

        def __init__(self, *_):
            pass

        def key(self, number):
            return f"s1-{number}"

        def case(self, number):
            if len(made) == stop[0] - 1:
                stop[0] = -1
                raise KeyboardInterrupt
            made.append(number)
            return BenchCase(self.key(number), {"recording.toml": "a rig"}, truth(self.key(number), "null"))

    started, real_run = [], Trial.run
    monkeypatch.setattr(Trial, "run", lambda self, of, files: started.append(of.name) or real_run(self, of, files))
    monkeypatch.setattr(run, "CaseSet", Cases)
    (tmp_path / "answer").write_text(SURE_OF_NONE)
    good = f"good=/bin/sh -c 'cat {tmp_path}/answer # {{folder}}'"
    arguments = ["--unsealed", "--entries", "", "--out", str(tmp_path / "out"), "--program", good]
    assert until_stopped(lambda: run.main(arguments)) == 130
    assert capsys.readouterr().err.splitlines()[-1] == "stopped; the same command goes on from here"
    assert run.main([*arguments, "--program", "bad=/bin/sh -c 'cat {folder}/*'"]) == 0
    assert made == [0, 0, 1]  # the first again for the other program
    assert started == ["good", "bad", "good", "bad"]
    out = capsys.readouterr().out
    (line,) = [text for text in out.splitlines() if text.startswith("all answers right")]
    assert line.index("100 % (34 to 100, n 2)") < line.index("0 % (0 to 66, n 2)")
    assert "bad, s1-1: line 1, column 1: no JSON (expecting value) in 'a rig'" in out
    assert run.main(arguments) == 0
    assert made == [0, 0, 1]
    assert run.main([*arguments, "--fresh"]) == 0
    assert made == [0, 0, 1, 0, 1]
